"""The TV's own GNSS receiver, on a channel that gets worse the more vehicles share it."""

import numpy as np

from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.sensing.passages import SensedRecord
from isac_cosim.isacsim.sensing.sensors.by_record import RecordPicture


class Gnss:
    label, cost_s, by_sites, filtered, unusable = "the target vehicle's GNSS receiver", 1e-6, False, False, "never"

    def refusal(self, settings):
        return None

    def watch(self, traffic, settings):
        return GnssPicture(traffic, float(settings.options.get("position_sd_m", 2.0)))


class GnssPicture(RecordPicture):
    def __init__(self, traffic, position_sd_m):
        super().__init__(traffic)
        vehicles = 1 if traffic.recording is None else len(traffic.recording.tracks)
        self.alone_m, self.sd_m = position_sd_m, position_sd_m * np.sqrt(vehicles)

    def record(self, passages):
        return [self.sensed(passage.truth, stream(*passage.key, "gnss")) for passage in passages]

    def sensed(self, truth, rng):
        state = truth + np.repeat([self.sd_m, 0.1, 0.3], 2)[:, None] * rng.standard_normal(truth.shape)
        return SensedRecord(state, state[:4], n_sites=0, snr_db=np.nan, detected=1.0, usable=True)

    def step(self, piece, uv_of):
        self.sd_m = self.alone_m * np.sqrt(len(piece.names))
        return super().step(piece, uv_of)


SENSOR = Gnss()
