"""From a scenario to a recording: SUMO, drivers who react, smooth motion. Knows nothing of labels or sensing."""
