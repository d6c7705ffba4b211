"""Windows: the same instant in both streams, nothing after it, the frame, and splits by seed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.split import SplitSettings, split
from isac_cosim.models.data.windows import (
    Ends,
    Records,
    WindowSettings,
    cut,
    draw_ends,
    end_bounds,
    lengths,
    to_moving,
    to_relative,
)
from tests.support.made_up import make_records

ABSOLUTE = WindowSettings(frame="absolute")


def with_clock(records: Records) -> Records:
    """The records with x replaced by the time since the record's start, s."""
    tv, uv = records.tv.copy(), records.uv.copy()
    tv[:, 0] = np.arange(tv.shape[2]) / records.tv_rate_hz
    uv[:, 0] = np.arange(uv.shape[2]) / records.uv_rate_hz
    return Records(tv, uv, records.tv_rate_hz, records.uv_rate_hz, records.table)


def test_both_streams_end_at_the_drawn_instant_and_are_contiguous(records: Records) -> None:
    clocked = with_clock(records)
    ends = draw_ends(clocked, ABSOLUTE, "test")
    windows = cut(clocked, ends, ABSOLUTE)
    since_start = ends.times(clocked) - clocked.table["t_start"].to_numpy()[ends.row]
    assert windows.tv.shape[1:] == (6, 880)
    assert windows.uv.shape[1:] == (6, 220)
    np.testing.assert_allclose(windows.tv[:, 0, -1], since_start, atol=1e-5)
    np.testing.assert_allclose(windows.uv[:, 0, -1], since_start, atol=1e-5)
    np.testing.assert_allclose(np.diff(windows.tv[:, 0], axis=1), 1 / 400, atol=1e-6)
    np.testing.assert_allclose(np.diff(windows.uv[:, 0], axis=1), 1 / 100, atol=1e-6)


def test_windows_on_the_map_are_the_same_in_the_scenario_s_plane(records: Records) -> None:
    maps = {"toy": object()}
    placed = replace(records, lane_maps=maps.__getitem__)  # type: ignore[arg-type]
    few = placed.take(np.arange(5, 40))
    ends = draw_ends(few, ABSOLUTE, "test")
    assert cut(records, ends, ABSOLUTE).on_map is None
    for frame in ("relative", "moving", "absolute"):
        on_map = cut(few, ends, WindowSettings(frame=frame)).on_map
        assert on_map is not None
        plain = cut(few, ends, ABSOLUTE)
        np.testing.assert_array_equal(on_map.tv, plain.tv)
        np.testing.assert_array_equal(on_map.uv, plain.uv)
        assert on_map.lane_maps(on_map.scenario[0]) is maps["toy"]
        assert len(on_map.scenario) == len(ends)


@pytest.mark.parametrize(
    ("relative_to", "after"), [("onset", (0.5, 2.2)), ("commit", (-0.4, 0.2)), ("onset", (-0.3, -0.3))]
)
def test_ends_stay_in_the_range_and_in_the_record(
    records: Records, relative_to: str, after: tuple[float, float]
) -> None:
    chosen = WindowSettings(relative_to=relative_to, end_after_s=after)  # type: ignore[arg-type]
    ends = draw_ends(records, chosen, "test", per_record=3)
    late = ends.times(records) - records.table[f"t_{relative_to}"].to_numpy()[ends.row]
    assert (late >= after[0] - 0.0051).all()
    assert (late <= after[1] + 0.0051).all()
    assert (ends.step >= 220).all()
    assert (ends.step <= 499).all()


def test_ends_fill_their_range(records: Records) -> None:
    ends = draw_ends(records, WindowSettings(), "test", per_record=50)
    late = ends.times(records) - records.table["t_onset"].to_numpy()[ends.row]
    assert late.mean() == pytest.approx((0.5 + 2.2) / 2, abs=0.02)
    assert late.std() == pytest.approx(1.7 / np.sqrt(12), abs=0.02)


def test_records_that_hold_no_such_window_are_left_out(records: Records) -> None:
    table = records.table.copy()
    table.loc[0, "t_onset"] += 10.0
    moved = Records(records.tv, records.uv, records.tv_rate_hz, records.uv_rate_hz, table)
    assert 0 not in draw_ends(moved, WindowSettings(), "test").row
    assert len(draw_ends(moved, WindowSettings(), "test")) == len(records) - 1
    with pytest.raises(InputError, match="end_after_s"):
        draw_ends(records, WindowSettings(end_after_s=(3.0, 4.0)), "test")


def test_too_long_a_window_is_refused(records: Records) -> None:
    with pytest.raises(InputError, match="window_s"):
        lengths(records, WindowSettings(window_s=6.0))


def test_a_record_of_one_window_length_has_one_end(records: Records) -> None:
    short = Records(records.tv[:, :, :881], records.uv[:, :, :221], 400.0, 100.0, records.table)
    first, last = end_bounds(short, WindowSettings(end_after_s=(-3.0, 3.0)))
    assert (first == 220).all()
    assert (last == 220).all()


@settings(max_examples=25, deadline=None)
@given(step=st.integers(220, 498), frame=st.sampled_from(["relative", "absolute"]))
def test_what_comes_after_the_end_changes_nothing(step: int, frame: str) -> None:
    records = make_records(1, 1)
    chosen = WindowSettings(frame=frame)  # type: ignore[arg-type]
    ends = draw_ends(records, chosen, "test")[:1]
    ends.step[:] = step
    tv, uv = records.tv.copy(), records.uv.copy()
    tv[:, :, 4 * step + 1 :] = np.nan
    uv[:, :, step + 1 :] = np.nan
    blind = cut(Records(tv, uv, 400.0, 100.0, records.table), ends, chosen)
    whole = cut(records, ends, chosen)
    np.testing.assert_array_equal(blind.tv, whole.tv)
    np.testing.assert_array_equal(blind.uv, whole.uv)


@settings(max_examples=25, deadline=None)
@given(angle=st.floats(-np.pi, np.pi), dx=st.floats(-5000, 5000), dy=st.floats(-5000, 5000))
def test_the_relative_frame_forgets_place_and_direction(angle: float, dx: float, dy: float) -> None:
    rng = np.random.default_rng(3)
    tv, uv = rng.normal(size=(4, 6, 40)), rng.normal(size=(4, 6, 10))
    uv[:, 0] += np.linspace(0, 50, 10)
    c, s = np.cos(angle), np.sin(angle)

    def moved(states: np.ndarray) -> np.ndarray:
        out = np.einsum("ij,npjt->npit", np.array([[c, -s], [s, c]]), states.reshape(4, 3, 2, -1))
        out[:, 0] += np.array([dx, dy])[:, None]
        return out.reshape(states.shape)

    for before, after in zip(to_relative(tv, uv), to_relative(moved(tv), moved(uv)), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-7)


def test_the_relative_frame_is_the_tv_start_and_the_uv_heading(records: Records) -> None:
    ends = draw_ends(records, WindowSettings(), "test")
    tv, uv = (x.astype(np.float64) for x in (cut(records, ends, ABSOLUTE).tv, cut(records, ends, ABSOLUTE).uv))
    tv, uv = to_relative(tv, uv)
    np.testing.assert_allclose(tv[:, :2, 0], 0, atol=1e-9)
    travel = uv[:, :2, -1] - uv[:, :2, 0]
    np.testing.assert_allclose(travel[:, 1], 0, atol=1e-6)
    assert (travel[:, 0] > 0).all()


@settings(max_examples=25, deadline=None)
@given(u=st.floats(-40, 40), v=st.floats(-40, 40))
def test_the_moving_frame_forgets_a_common_velocity(u: float, v: float) -> None:
    rng = np.random.default_rng(4)
    tv, uv = rng.normal(size=(3, 6, 40)), rng.normal(size=(3, 6, 10))
    times = np.arange(40) / 400, 0.0075 + np.arange(10) / 100
    faster = [x.copy() for x in (tv, uv)]
    for states, t in zip(faster, times, strict=True):
        states[:, 0:2] += np.array([u, v])[:, None] * t
        states[:, 2:4] += np.array([u, v])[:, None]
    pairs = zip(to_moving(tv, uv, times[0][-1], 0.0075), to_moving(*faster, times[0][-1], 0.0075), strict=True)
    for before, after in pairs:
        np.testing.assert_allclose(after, before, atol=1e-9)


def test_the_moving_frame_starts_at_rest(records: Records) -> None:
    ends = draw_ends(records, WindowSettings(), "test")
    windows = cut(records, ends, WindowSettings(frame="moving"))
    np.testing.assert_allclose(windows.tv[:, 2:4, :44].mean(axis=2), 0, atol=1e-3)
    assert np.abs(windows.tv[:, 0, -1]).max() < 30


def test_a_standing_uv_lends_its_place_to_the_tv_and_two_standing_vehicles_keep_the_axes() -> None:
    tv, uv = np.zeros((2, 6, 8)), np.ones((2, 6, 4))
    tv[0, 1] = np.arange(8)
    turned, _ = to_relative(tv, uv)
    np.testing.assert_allclose(turned[0, 0], np.arange(8), atol=1e-12)
    _, kept = to_relative(tv, uv)
    np.testing.assert_allclose(kept[1, 2:], 1)


def test_an_end_outside_its_record_is_an_error(records: Records) -> None:
    for step in (219, 500):
        with pytest.raises(ValueError, match="220 to 499 fit"):
            cut(records, Ends(np.array([0]), np.array([step])), WindowSettings())


def test_a_draw_depends_on_the_sample_and_the_keys_alone(records: Records) -> None:
    order = np.arange(len(records))[::-1].copy()
    ends = draw_ends(records, WindowSettings(), "train", 1, 5)
    reordered = draw_ends(records.take(order), WindowSettings(), "train", 1, 5)
    np.testing.assert_array_equal(reordered.step, ends.step[::-1])
    assert (draw_ends(records, WindowSettings(), "train", 1, 6).step != ends.step).mean() > 0.9


def test_no_seed_is_on_two_sides_and_every_intention_on_each(records: Records) -> None:
    sides = split(records, SplitSettings())
    everything = [group for side in sides.values() for group in side]
    assert sorted(everything) == sorted(set(records.groups))
    for side in sides.values():
        assert set(records.label[np.isin(records.groups, side)]) >= {int(i) for i in KNOWN}
    assert split(records, SplitSettings()) == sides


def test_a_rare_intention_is_on_each_side() -> None:
    records = make_records(10, 1)
    rare = (records.label == 5) & (records.table["seed"].to_numpy() >= 3)
    sides = split(records.take(~rare), SplitSettings())
    assert {side for side, groups in sides.items() for k in range(3) if f"toy-{k}" in groups} == set(sides)


def test_a_smaller_training_share_is_part_of_a_larger_and_moves_no_other_side() -> None:
    records = make_records(12, 1)
    whole = split(records, SplitSettings())
    parts = [split(records, SplitSettings(training_share=share)) for share in (0.1, 0.3, 0.6)]
    assert [len(part["train"]) for part in parts] == [round(share * len(whole["train"])) for share in (0.1, 0.3, 0.6)]
    assert set(parts[0]["train"]) < set(parts[1]["train"]) < set(parts[2]["train"]) < set(whole["train"])
    for part in parts:
        assert (part["validation"], part["test"]) == (whole["validation"], whole["test"])
        assert sorted(part["train"] + part["unused"]) == whole["train"]


def test_three_seeds_are_the_least() -> None:
    assert [len(side) for side in split(make_records(3, 1), SplitSettings(test=0.6)).values()] == [1, 1, 1]
    with pytest.raises(InputError, match="2 scenario seed"):
        split(make_records(2, 1), SplitSettings())
