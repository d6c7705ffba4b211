"""What the speed claims rest on: each benchmark measures both sides of a ratio in one run."""
