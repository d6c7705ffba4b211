"""What the experiments of both papers share: stages, trainings, sensing cases, claims and their pages."""
