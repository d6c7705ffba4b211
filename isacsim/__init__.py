"""From a scenario to what the network knows of its vehicles: traffic, echoes, fixes and tracks. Labels are unknown.

In come SUMO's files, or files of trajectories; out come the states of vehicles, true and as the network knows them.
"""
