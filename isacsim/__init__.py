"""From a scenario to what the network knows of its vehicles: traffic, echoes, fixes and tracks. Labels are unknown."""
