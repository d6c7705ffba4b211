"""Which stretches of traffic are watched, how they are sensed and predicted, and how the answers are stored."""
