"""What all networks share: windows in, logits out, losses and the training loop. Knows no particular network."""
