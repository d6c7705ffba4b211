"""Traffic and sensing: from a SUMO scenario to what the mobile network knows of a vehicle."""
