"""From a scenario to a recording: SUMO, commanded maneuvers, smooth motion. Knows nothing of labels or sensing."""
