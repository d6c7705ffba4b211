"""The columns of a dataset's tables in a sentence each, for its README.md and its Croissant description.

docs/dataset.md describes them in full.
"""

from __future__ import annotations

COLUMNS = {
    "sample_id": "name of the sample, SCENARIO-SEED-NUMBER",
    "scenario": "road network with its demand and its sites",
    "seed": "seed of the traffic; split by it, never by sample: vehicles of one seed drove together",
    "source": "where the motion comes from",
    "tv_id": "target vehicle (TV), which is sensed",
    "uv_id": "own vehicle (UV), which reports its own state",
    "intention": "what the TV does",
    "label": "the intention as a number",
    "origin": "natural, reaction or commanded",
    "cause": "what the driver reacted to; empty unless the origin is reaction",
    "cause_ttc_s": "time to collision with the cause when the driver began to move, s",
    "t_start": "simulation time at which the record starts, s",
    "t_onset": "simulation time at which the maneuver begins, s",
    "t_commit": "simulation time at which the maneuver is certain, s",
    "t_end": "simulation time at which the maneuver ends, s",
    "pull_out": "what became of a pull-out behind the UV",
    "t_pass": "simulation time at which the TV passes the UV, s",
    "t_pair_end": "simulation time until which the pair is observed, s",
    "sensor": "what sensed the TV",
    "snr_db": "SNR per antenna element, mean over the record, dB",
    "n_sites": "number of sites used, the least over the record",
    "x0": "x of the point in the scenario's plane to which positions are relative, m",
    "y0": "y of the point in the scenario's plane to which positions are relative, m",
    "tv_departed": "simulation time at which the demand lets the TV depart, s",
    "track_id": "which of the network's tracks stands for the TV, in a scene",
    "right_share": "share of the record in which the track was of the TV",
    "breaks": "how often the track was lost",
    "position_sd_m": "standard deviation of the position as the track states it, m",
    "tv": "states of the TV as sensed: x, y, vx, vy, ax, ay; m, m/s, m/s2",
    "tv_truth": "true states of the TV: x, y, vx, vy, ax, ay; m, m/s, m/s2",
    "uv": "states that the UV reports: x, y, vx, vy, ax, ay; m, m/s, m/s2",
    "tv_run_in": "true states of the TV before the record, in which the filter settles",
}
"""Of the samples and of the pull-outs."""
ROAD_COLUMNS = {
    "id": "id of the lane",
    "width_m": "width, m",
    "x": "x of the centre line in the scenario's plane, m",
    "y": "y of the centre line in the scenario's plane, m",
}
