"""What all networks share: windows in, logits out, losses and the training loop. Knows no particular network.

In come windows and labels; out come trained networks, and their checkpoints and history as files.
"""
