"""Draw docs/figures/labels.png: one event of each intention from a recording, with its onset, commit and end.

python docs/label_figures.py
"""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes

from isac_cosim.evaluation.report.figures import figure
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.protocol import vehicle_view
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention
from isac_cosim.labeling.road.road_motion import RoadMotion
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import RecordSettings, candidates
from isac_cosim.labeling.samples.uv_choice import PairSettings

ALONG = (Intention.HARD_BRAKE, Intention.HARD_ACCEL, Intention.FOLLOWING)
TIMES = (("onset", "tab:green"), ("commit", "black"), ("end", "tab:red"))
SEED = 2


def draw_event(ax: Axes, event: Event, motion: RoadMotion, settings: LabelSettings) -> None:
    """Draw the motion along the road, or across it, around one event."""
    visible = (motion.times > event.onset - 4) & (motion.times < max(event.end, event.onset + 4) + 2)
    t = motion.times[visible] - event.onset
    if event.intention in ALONG:
        ax.plot(t, motion.a[visible], label="acceleration, m/s²")
        ax.plot(t, motion.v[visible] - motion.v[visible][0], label="speed gained, m/s")
        levels = {
            Intention.HARD_BRAKE: -settings.hard_brake.threshold_mps2,
            Intention.HARD_ACCEL: settings.hard_accel.threshold_mps2,
        }
        if event.intention in levels:
            ax.axhline(levels[event.intention], color="0.7", lw=0.8, ls="--")
    else:
        ax.plot(t, motion.q[visible] - motion.lateral_at(event.onset), label="lateral position, m")
        ax.plot(t, motion.vq[visible], label="lateral speed, m/s", lw=1)
        ax.plot(t, motion.aq[visible], label="lateral acceleration, m/s²", lw=1, color="tab:purple")
    for name, color in TIMES:
        ax.axvline(getattr(event, name) - event.onset, color=color, lw=1, label=name)
    ax.set_title(event.intention.text.replace("_", " "))
    ax.set_xlabel("time from onset, s")


def draw(recording: Recording, path: Path) -> None:
    """Draw one panel for each intention: of the events that become samples, the one with the median peak."""
    settings, surroundings = LabelSettings(), Surroundings(recording)
    labels = label(recording, settings, surroundings)
    samples = candidates(recording, labels, PairSettings(), RecordSettings(), surroundings).samples
    sampled = {(sample.tv, sample.t_onset) for sample in samples}
    with figure(path, 16, 7, style={}, dpi=90) as drawn:
        axes = drawn.subplots(2, 4)
        for ax, intention in zip(axes.flat, Intention, strict=False):
            events = [event for event in labels.of(intention) if (event.vehicle, event.onset) in sampled]
            events.sort(key=lambda event: abs(event.peak))
            if not events:
                ax.set_title(f"{intention.text}: none in this recording")
                continue
            event = events[len(events) // 2]
            view = vehicle_view(recording, event.vehicle, surroundings, settings.width_s)
            draw_event(ax, event, view.motion, settings)
        handles = {}
        for ax in axes.flat[:-1]:
            handles.update({text: handle for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)})
        axes.flat[-1].axis("off")
        axes.flat[-1].legend(list(handles.values()), list(handles), loc="center", frameon=False)


def main() -> None:
    recording = record(load("motorway"), SEED, TrafficSettings(), ManeuverSettings())
    draw(recording, Path(__file__).with_name("figures") / "labels.png")


if __name__ == "__main__":
    main()
