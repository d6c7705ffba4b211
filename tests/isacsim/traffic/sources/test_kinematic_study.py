"""studies/kinematic.toml against the code: it lists every setting with its default."""

from __future__ import annotations

import importlib.resources
import re
from pathlib import Path

from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.sources.kinematic_settings import KinematicSettings
from isac_cosim.studies.study import read_study

STUDY = Path(str(importlib.resources.files("isac_cosim.studies") / "kinematic.toml"))
DEFAULTS = KinematicSettings()
SECTIONS = {"kinematics": DEFAULTS} | {name: value for name, value in DEFAULTS if isinstance(value, Settings)}


def test_the_study_file_lists_every_default_and_splits_like_the_paper() -> None:
    study = read_study(STUDY)
    assert study.dataset.kinematics == DEFAULTS
    listed = re.findall(r"^(\w+) = ", STUDY.read_text(encoding="utf-8"), flags=re.MULTILINE)
    for settings in SECTIONS.values():
        names = {name for name in type(settings).model_fields if not isinstance(getattr(settings, name), Settings)}
        assert names <= set(listed)
    episodes, per_episode = len(study.dataset.seeds), 6 * study.dataset.kinematics.per_class
    assert episodes * per_episode == 7200
    for share in (study.training.split.validation, study.training.split.test):
        assert abs(round(share * episodes) * per_episode - 1200) < per_episode
    assert study.training.optimiser.clip_norm == 0.0
