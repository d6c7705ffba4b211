"""What the commands of `cosim` share: their options, and how results are shown to people."""
