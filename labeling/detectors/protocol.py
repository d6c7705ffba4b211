"""What a detector is: the view of a vehicle that it gets, and the interface that it implements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.intentions import Event, Intention
from isac_cosim.labeling.road.road_motion import WIDTH_S, RoadMotion, road_motion
from isac_cosim.labeling.road.surroundings import Surroundings


@dataclass(frozen=True)
class VehicleView:
    """One vehicle as a detector sees it.

    motion: its conditioned motion along and across the road. surroundings: the positions of all vehicles of the
    recording. lane_changes: all completed lane changes of the vehicle in order of crossing, as the built-in
    `LaneChangeDetector` finds them, including those that end up in an overtake or a swerve. events: the events of the
    vehicle that the detectors before this one found, after precedence.
    """

    motion: RoadMotion
    surroundings: Surroundings
    lane_changes: tuple[Event, ...] = ()
    events: tuple[Event, ...] = ()

    @property
    def vehicle(self) -> str:
        """The id of the vehicle."""
        return self.motion.vehicle

    @property
    def track(self) -> Track:
        """The raw states of the vehicle. Do not differentiate them: `motion` is conditioned, they are not."""
        return self.surroundings.recording.tracks[self.vehicle]


class Detector(Protocol):
    """Finds the events of one or more intentions in the motion of one vehicle.

    The class is constructed with one argument, an instance of its `settings_type`, and keeps no state between vehicles.

    settings_type: the class of its settings, a subclass of `base.settings.Settings` whose fields all have defaults.
    finds: the intentions that its events may have. The seven intentions are fixed: a detector adds another definition
    of an intention, never another class.

    A study runs the built-in detectors by default. It selects any other registered detector by name:

        [dataset.labels]
        preset = "gentle-1"
        [dataset.labels.detectors.gentle_brake]
        threshold_mps2 = 3.0

    A selected detector **replaces** the built-in definition of every intention in its `finds`; built-in events of those
    intentions are dropped. Two selected detectors with an intention in common are refused. From then on its events are
    treated as built-in ones are, with the precedence of `labeling.detectors.events`. Two consequences for lane changes:

    - `VehicleView.lane_changes` always comes from the built-in lane-change detector, as do the counts of crossings that
      are no events.
    - Where `left_lane_change` or `overtake` is replaced, the built-in overtake rule is not applied to the UV of each
      sample. A `left_lane_change` stays what it is. An `overtake` counts for the UV named by `Event.other`, or for any
      UV where `other` is None; for another UV it is a change to the faster side that ends at `Event.busy_until`.

    The detectors run in the order of the registry. Those that find `following` run last, because following is where
    nothing else happens. An installed package registers a detector class as an entry point of the group
    `isac_cosim.detectors`. It has to be importable in every worker process that generates samples.
    """

    settings_type: ClassVar[type[Settings]]
    finds: ClassVar[tuple[Intention, ...]]

    def __init__(self, settings: Settings) -> None: ...

    def detect(self, view: VehicleView) -> list[Event]:
        """Return the events of one vehicle, in order of onset.

        Each event names `view.vehicle` and an intention in `finds`, and its times are finite with onset <= commit <=
        end, in s of simulation time. An event with a `mark` becomes no sample; it is counted under that mark.
        The result depends on the view alone: the same view gives the same events.
        """
        ...


def vehicle_view(
    recording: Recording, vehicle: str, surroundings: Surroundings | None = None, width_s: float = WIDTH_S
) -> VehicleView:
    """Return the view of one vehicle of a recording, without lane changes or other events.

    surroundings: of the recording, if already at hand. width_s: standard deviation of the conditioning kernel, s.
    """
    surroundings = Surroundings(recording) if surroundings is None else surroundings
    motion = road_motion(recording, recording.tracks[vehicle], surroundings.graph, width_s)
    return VehicleView(motion, surroundings)
