"""Figures draw the data they are given, and are pictures."""

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image

from bench.figures import gait, joints, path, timing
from bench.figures.film import film_strip, write_gif
from bench.figures.style import INK, STANCE, save
from bench.figures.tables import aligned, markdown
from bench.recording import JointTrack

T_S = np.arange(0.0, 2.0, 0.02)


def track(joint, lag_s=0.05):
    return JointTrack(joint, 1, T_S, 0.3 * np.sin(T_S), T_S + 0.001, 0.3 * np.sin(T_S - lag_s))


def leg():
    return [track(f"leg1.{part}") for part in ("coxa", "femur", "tibia")]


def line(axes, label):
    return next(drawn for drawn in axes.get_lines() if drawn.get_label() == label)


def test_a_joint_figure_has_a_panel_a_joint_in_degrees():
    figure = joints.joint_figure(leg())
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["coxa", "femur", "tibia"]
    measured = line(figure.axes[1], "measured")
    np.testing.assert_allclose(measured.get_xdata(), T_S + 0.001)
    np.testing.assert_allclose(measured.get_ydata(), np.degrees(leg()[1].position_rad))


def test_goals_are_steps_that_hold_to_the_end():
    short = JointTrack("leg1.coxa", 1, T_S[:3], np.radians([1.0, 2.0, 3.0]), T_S, np.zeros(100))
    goal = line(joints.joint_figure([short]).axes[0], "goal")
    assert goal.get_drawstyle() == "steps-post"
    np.testing.assert_allclose(goal.get_ydata(), [1.0, 2.0, 3.0, 3.0])
    assert goal.get_xdata()[-1] == pytest.approx(T_S[-1])


def test_goals_outside_the_window_do_not_stretch_the_axis():
    goal_rad = np.radians(np.where(T_S < 0.3, 90.0, 1.0))
    still = JointTrack("leg1.coxa", 1, T_S, goal_rad, T_S, np.full(100, np.radians(2.0)))
    axes = joints.joint_figure([still], window_s=(0.5, 0.9)).axes[0]
    assert axes.get_ylim()[1] < 3.0
    goal = line(axes, "goal")
    assert goal.get_xdata()[0] == 0.5, "the goal in force where the window begins is drawn"
    np.testing.assert_allclose(goal.get_ydata(), 1.0)


def test_the_error_over_the_window_stands_in_the_panel():
    off = JointTrack("leg1.coxa", 1, T_S, np.radians(T_S * 0 + 2.0), T_S, np.zeros_like(T_S))
    assert joints.joint_figure([off]).axes[0].get_title(loc="right").endswith("2.0°")


def test_stance_is_shaded_inside_the_window():
    stance = np.array([[0.1, 0.4], [0.6, 3.0], [4.0, 5.0]])
    axes = joints.joint_figure(leg(), stance=stance, window_s=(0.2, 1.0)).axes[0]
    shades = [p for p in axes.patches if to_hex(p.get_facecolor()) == STANCE]
    found = [(s.get_extents().x0, s.get_extents().x1) for s in shades]
    wanted = [
        tuple(axes.transData.transform([(a, 0), (b, 0)])[:, 0]) for a, b in ((0.2, 0.4), (0.6, 1.0))
    ]
    np.testing.assert_allclose(found, wanted)


def test_a_joint_without_goals_or_positions_is_drawn_empty():
    nothing = np.empty(0)
    figure = joints.joint_figure([JointTrack("leg1.coxa", 1, nothing, nothing, nothing, nothing)])
    assert figure.axes[0].get_title(loc="right") == ""


def test_spans_are_where_the_foot_is_down():
    t_s = np.array([0.0, 0.1, 0.2, 0.3, 0.4])
    down = np.array([True, False, True, True, True])
    np.testing.assert_allclose(gait.spans(t_s, down), [[0.0, 0.1], [0.2, 0.4]])
    assert gait.spans(t_s, ~(down | True)).shape == (0, 2)
    assert gait.spans(t_s[:0], down[:0]).shape == (0, 2)


def test_contact_is_a_force_over_the_threshold():
    force_n = np.array([0.0, 0.5, 2.0, 0.5, 0.0])
    t_s = np.arange(5.0)
    np.testing.assert_allclose(gait.contact_spans(t_s, force_n, 1.0), [[2.0, 3.0]])
    np.testing.assert_allclose(gait.contact_spans(t_s, force_n), [[1.0, 4.0]])


def test_a_duty_factor_is_the_share_of_time_in_stance():
    stance = np.array([[0.0, 0.6], [1.0, 1.6], [2.0, 2.6], [3.0, 3.6]])
    assert gait.duty_factor(stance, 4.0) == pytest.approx(0.6)


def test_a_gait_figure_has_a_black_bar_a_span_in_the_row_of_its_leg():
    stances = {f"leg{n}": np.array([[0.1 * n, 0.1 * n + 0.5]]) for n in range(1, 7)}
    axes = gait.gait_figure(stances, window_s=(0.2, 2.0)).axes[0]
    names = [text.get_text() for text in axes.get_yticklabels()]
    assert names[:3] == ["left front (leg1)", "left middle (leg5)", "left rear (leg3)"]
    assert names[3:] == ["right front (leg2)", "right middle (leg6)", "right rear (leg4)"]
    bars = [bar.get_paths()[0].get_extents() for bar in axes.collections]
    np.testing.assert_allclose([b.x0 for b in bars], [0.2, 0.5, 0.3, 0.2, 0.6, 0.4])
    np.testing.assert_allclose([(b.y0 + b.y1) / 2 for b in bars], range(6))
    assert {to_hex(bar.get_facecolor()[0]) for bar in axes.collections} == {INK}
    assert axes.get_ylim()[0] > axes.get_ylim()[1], "the first leg is on top"


def test_a_leg_that_is_never_down_has_an_empty_row():
    axes = gait.gait_figure({"leg1": np.empty((0, 2)), "leg2": np.array([[0.0, 1.0]])}).axes[0]
    assert [text.get_text() for text in axes.texts] == ["0%", "100%"]


def test_a_displacement_is_measured_as_the_crow_flies():
    left = np.full(2, np.pi / 2)  # looks along -x
    moved = path.displacement(np.array([1.0, 3.0]), np.array([0, -2.0]), np.array([0, 0.5]), left)
    assert moved.distance_m == pytest.approx(np.hypot(2.0, 0.5))
    assert moved.speed_m_s == pytest.approx(moved.distance_m / 2.0)


def test_a_turn_counts_past_half_a_turn():
    yaw = np.linspace(0.0, 4.0, 50)
    wrapped = np.arctan2(np.sin(yaw), np.cos(yaw))
    assert path.displacement(T_S[:50], yaw, yaw, wrapped).turned_rad == pytest.approx(4.0)
    with pytest.raises(ValueError, match="at least one sample"):
        path.displacement(*[np.empty(0)] * 4)


def test_a_path_figure_is_to_scale_with_headings_start_and_stop():
    axes = path.path_figure(T_S, 0.1 * T_S, 0.2 * T_S, 0.0 * T_S).axes[0]
    assert axes.get_aspect() == 1.0
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), 0.2 * T_S)
    assert line(axes, "start").get_xdata()[0] == 0.0
    assert line(axes, "stop").get_xdata()[0] == pytest.approx(0.1 * T_S[-1])
    (arrows,) = axes.collections
    np.testing.assert_allclose(arrows.U, 0.0, atol=1e-12)
    assert (arrows.V > 0.0).all(), "a yaw of 0 looks along y"
    assert "0.443 m in 2.0 s" in axes.get_title(loc="left")


def test_a_body_that_stands_still_can_be_drawn():
    axes = path.path_figure(T_S, 0.0 * T_S, 0.0 * T_S, 0.0 * T_S).axes[0]
    assert axes.get_xlim()[1] - axes.get_xlim()[0] > 0.05


def timing_rows():
    return [
        timing.TimingRow("writing all 18", np.linspace(5e-4, 6e-4, 101), 5.8e-4, 1e-3, True),
        timing.TimingRow("reading one", np.empty(0), None, 3e-3),
    ]


def test_a_timing_figure_of_many_lines_stays_on_a_page():
    few, many = (timing.timing_figure(timing_rows()[:1] * n) for n in (5, 60))
    assert few.get_figheight() == pytest.approx(1.2 + 5 * timing.ROW_IN)
    assert many.get_figheight() < 20.0


def test_a_timing_figure_shows_median_whiskers_model_and_thesis_in_ms():
    axes = timing.timing_figure(timing_rows()).axes[0]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["writing all 18", "reading one"]
    assert timing_rows()[0].summary_s == pytest.approx((5.05e-4, 5.5e-4, 5.95e-4))
    assert axes.patches[0].get_width() == pytest.approx(0.55)
    (whisker, *_) = axes.collections[0].get_segments()
    np.testing.assert_allclose(whisker[:, 0], [0.505, 0.595])
    np.testing.assert_allclose(line(axes, "modelled").get_xdata(), [0.58])
    np.testing.assert_allclose(line(axes, "thesis").get_xdata(), [1.0, 3.0])
    assert {"0.55 ms", "-", "at most"} == {text.get_text() for text in axes.texts}


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_every_figure_becomes_a_file(tmp_path, suffix):
    stances = {"leg1": np.array([[0.0, 1.0]])}
    figures = [
        joints.joint_figure(leg(), stance=stances["leg1"]),
        gait.gait_figure(stances),
        gait.gait_figure({}),
        path.path_figure(T_S, T_S, T_S, T_S),
        timing.timing_figure(timing_rows()),
        timing.timing_figure([]),
    ]
    magic = {".png": b"\x89PNG\r\n\x1a\n", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix]
    for number, figure in enumerate(figures):
        file = save(figure, tmp_path / f"{number}{suffix}")
        assert file.read_bytes().startswith(magic)
        if suffix == ".png":
            Image.open(file).verify()


def frames(count=10):
    return [np.full((20, 30, 3), (8 * i, 100, 0), dtype=np.uint8) for i in range(count)]


def test_a_film_strip_spreads_its_stills_from_first_to_last():
    strip = film_strip(frames(), [0.1 * i for i in range(10)], count=4)
    assert strip.size[0] == 4 * 30 + 3 * 4
    found = [strip.getpixel((place * 34 + 15, 10))[0] for place in range(4)]
    assert found == [0, 24, 48, 72]
    folded = film_strip(frames(), range(10), count=4, columns=2)
    assert folded.getpixel((15, folded.size[1] // 2 + 10))[0] == 48


def test_a_gif_shows_every_frame_and_keeps_the_length(tmp_path):
    with Image.open(write_gif(frames(30), tmp_path / "film.gif", frame_s=1 / 30)) as film:
        assert film.n_frames == 30
        shown, total_ms = [], 0
        for number in range(30):
            film.seek(number)
            total_ms += film.info["duration"]
            shown.append(film.convert("RGB").getpixel((15, 10))[0])
        assert film.info["loop"] == 0
    assert total_ms == 1000
    np.testing.assert_allclose(shown, [8 * i for i in range(30)], atol=4)


def test_frames_that_do_not_fit_together_are_refused(tmp_path):
    odd = [*frames(2), np.zeros((5, 5, 3), dtype=np.uint8)]
    with pytest.raises(ValueError, match=r"frame 2 is \(5, 5, 3\), the first is \(20, 30, 3\)"):
        write_gif(odd, tmp_path / "film.gif", frame_s=0.1)
    with pytest.raises(ValueError, match="no frames"):
        film_strip([], [])
    with pytest.raises(ValueError, match="2 frames, but 1 times"):
        film_strip(frames(2), [0.0])
    with pytest.raises(ValueError, match=r"at least 0\.02"):
        write_gif(frames(2), tmp_path / "film.gif", frame_s=0.01)
    with pytest.raises(ValueError, match="array of uint8"):
        film_strip([np.zeros((5, 5, 3))], [0.0])


COLUMNS = ("kind", "thesis [ms]", "note")
ROWS = [("reading one", "3", "a|b"), ("reading all 18", "13.07", "")]


def test_rows_as_plain_text_are_aligned_with_numbers_to_the_right():
    assert aligned(COLUMNS, ROWS) == (
        "kind            thesis [ms]  note\n"
        "--------------  -----------  ----\n"
        "reading one               3  a|b\n"
        "reading all 18        13.07"
    )


def test_the_same_rows_as_markdown():
    assert markdown(COLUMNS, ROWS) == (
        "| kind | thesis [ms] | note |\n| --- | ---: | --- |\n"
        "| reading one | 3 | a\\|b |\n| reading all 18 | 13.07 |  |"
    )


def test_a_row_of_another_length_is_refused():
    for render in (aligned, markdown):
        with pytest.raises(ValueError, match="row 2 has 1 cells, not 3"):
            render(COLUMNS, [ROWS[0], ("x",)])


def test_a_table_without_rows_has_its_header():
    assert aligned(("a", "b"), []) == "a  b\n-  -"
