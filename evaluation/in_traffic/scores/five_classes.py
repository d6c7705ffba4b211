"""Overtakes and the lane changes that they begin with as one intention, in running traffic.

Whether a vehicle that pulls out overtakes is often decided after its alarm is due. With six intentions, an alarm for a
lane change is false if the vehicle turns out to overtake, and pulling-outs with an open outcome are neutral; with five,
all of them are lane changes, to score alarms and to train on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from isac_cosim.evaluation.in_traffic.scores.scoring import Truth
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.labeling.intentions import KNOWN, Intention, outward
from isac_cosim.labeling.samples.pull_outs import DROPPED
from isac_cosim.labeling.streams.events import LiveEvent

OVERTAKE = KNOWN.index(Intention.OVERTAKE)
OVERTAKE_TEXT = Intention.OVERTAKE.text


def as_five(truth: Truth, lefthand: bool, before_onset_s: float) -> Truth:
    """Return an episode in which overtakes are lane changes to the faster side, in its events and in all answers.

    lefthand: whether traffic keeps left. before_onset_s: how early before onset an alarm may come, s.
    """
    episode, change = truth.episode, outward(lefthand)
    events = tuple(_as_change(event, change) for event in episode.facts.events)
    facts = episode.facts.model_copy(update={"events": events})
    return Truth.of(replace(episode, facts=facts, answers=_merged(episode.answers, change)), before_onset_s)


def _as_change(event: LiveEvent, change: Intention) -> LiveEvent:
    """Return an event as a lane change where it is an overtake, or a pulling-out with an open outcome."""
    if event.left_out in DROPPED:
        return event.model_copy(update={"intention": change.text, "left_out": None})
    return event.model_copy(update={"intention": change.text}) if event.intention == OVERTAKE_TEXT else event


def _merged(answers: Mapping[str, Answers], change: Intention) -> dict[str, Answers]:
    """Return answers in which a lane change has the probability of an overtake, too, and an overtake none."""
    merged = {}
    for name, of_predictor in answers.items():
        probabilities = of_predictor.probabilities.copy()
        probabilities[:, KNOWN.index(change)] += probabilities[:, OVERTAKE]
        probabilities[:, OVERTAKE] = 0.0
        merged[name] = replace(of_predictor, probabilities=probabilities)
    return merged
