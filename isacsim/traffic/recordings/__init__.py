"""What was driven: the states of all vehicles, logged at every step or rebuilt from samples."""
