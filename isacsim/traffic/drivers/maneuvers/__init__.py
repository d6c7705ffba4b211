"""What the director can make happen, one kind a file: its settings, how it is drawn, and how it is driven."""
