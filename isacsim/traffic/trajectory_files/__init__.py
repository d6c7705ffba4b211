"""From files of trajectories to recordings: tables read with bounds, states checked, cut into blocks, placed in lanes.

Nothing here knows a format; `isacsim.traffic.sources` has one module for each.
"""
