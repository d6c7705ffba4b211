"""The class whose mean window is nearest."""

import numpy as np
from pydantic import Field

from isac_cosim.base.files import replace_file
from isac_cosim.base.settings import Settings
from isac_cosim.models.predictors.protocol import Outputs, Predictor, among_known


class NearestSettings(Settings):
    ends_per_record: int = Field(2, ge=1, description="training windows drawn of each record")


class Nearest(Predictor):
    display_name, summary, settings_class = "nearest mean", "the class whose mean window is nearest", NearestSettings

    def __init__(self, means, classes):
        self.means, self.classes = means, classes

    @classmethod
    def fit(cls, task, feedback):
        ends, label = task.training_ends(task.settings.of(NearestSettings).ends_per_record)
        flat = np.concatenate([w.tv.reshape(len(w.tv), -1) for w in task.batches(ends)])
        return cls(np.stack([flat[label == k].mean(axis=0) for k in np.unique(label)]), np.unique(label))

    def save(self, folder):
        replace_file(folder / "nearest.npz", lambda path: np.savez(path, means=self.means, classes=self.classes))

    @classmethod
    def load(cls, folder, settings, shape):
        with np.load(folder / "nearest.npz", allow_pickle=False) as stored:
            return cls(stored["means"], stored["classes"])

    def __call__(self, windows):
        flat = windows.tv.reshape(len(windows.tv), 1, -1).astype(np.float64)
        logits = among_known(-np.linalg.norm(flat - self.means, axis=2), self.classes)
        return Outputs(logits, logits)
