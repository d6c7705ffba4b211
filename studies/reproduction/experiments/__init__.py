"""What the experiments of both papers share: stages, trainings, sensing cases, claims and their pages.

In come the trainings and claims of a paper; out come files of scores, verdicts, tables and a page.
"""
