"""``import treadline as tl``: light, complete, and results that print."""

import ast
import gc
import inspect
import json
import subprocess
import sys
import tomllib
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from frame_files import points_of_frame, write_calibration, write_pcd
from scenes import ViewRecipe, draw_view
from systems import system

import treadline as tl
from treadline import api
from treadline.campaign.spec import read_spec
from treadline.core.camera_images import NamedFrame
from treadline.core.errors import ImageError, RecordError, SettingsError, TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import CAMERAS, CHAIRS

PUBLIC = {
    "IdentificationOptions", "Identified", "LinearModel", "Run", "Scenario", "Sweep", "check", "climb", "detect_ground",
    "detect_stair", "export", "frame_of_points", "identify", "load_model", "read_frames", "read_scenario", "scenarios", "sweep",
    "tune",
}  # fmt: skip
SHORT = {"drive": {"duration_s": 0.5}, "sensors": {"camera": "statistical"}}


def test_the_import_takes_less_than_a_tenth_of_a_second_and_loads_nothing_heavy() -> None:
    code = (
        "import sys, time; a = time.process_time(); import treadline; b = time.process_time();"
        "print(b - a, *[m for m in ('numpy', 'scipy', 'numba', 'mujoco', 'cv2', 'matplotlib', 'pydantic') if m in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert float(said[0]) < 0.1  # CPU time: a busy machine does not count
    assert said[1:] == []


def test_the_package_exports_what_users_need_and_nothing_else() -> None:
    assert set(tl.__all__) - {"__version__"} == PUBLIC
    assert set(dir(tl)) == {*PUBLIC, "__version__"}  # a completion in a shell offers no helper
    for name in PUBLIC:
        item = getattr(tl, name)
        assert inspect.isclass(item) or inspect.isfunction(inspect.unwrap(item))
        assert item.__doc__
    with pytest.raises(AttributeError, match="no attribute 'clime'"):
        tl.clime  # noqa: B018


def test_the_stub_for_type_checkers_names_the_same_things() -> None:
    stub = Path(tl.__file__).with_suffix(".pyi").read_text()
    assert {line.rsplit(" ", 1)[1] for line in stub.splitlines() if line.startswith("from")} == PUBLIC


def integrator(samples: int = 400) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    u = rng.standard_normal((samples, 2))
    y = np.zeros((samples, 2))
    for k in range(samples - 1):
        y[k + 1, 1] = 0.5 * y[k, 1] + 0.3 * (u[k, 1] - u[k, 0])
        y[k + 1, 0] = y[k, 0] + 0.25 * y[k, 1]
    return u, y + 1e-3 * rng.standard_normal(y.shape)


class Frame:
    """What pandas and polars have in common: columns with names, and an array."""

    def __init__(self, columns: list[str], values: Any) -> None:
        self.columns, self._values = columns, values

    def to_numpy(self) -> Any:
        return self._values


def test_arrays_become_a_model_that_can_be_saved_loaded_and_tuned(tmp_path: Path) -> None:
    u, y = integrator()
    found = tl.identify(u, y, 0.25, order=2, method="okid-era")
    poles = sorted(abs(np.linalg.eigvals(found.model.A)))
    np.testing.assert_allclose(poles, [0.5, 1.0], atol=0.02)  # noise of 1e-3 on outputs of 0.3: a percent of a pole
    path = tmp_path / "model.json"
    found.model.save(path)
    for given in (path, str(path)):
        assert (tl.load_model(given).A == found.model.A).all()
    gains = [tl.tune(model).K for model in (found, found.model, path, str(path))]
    assert all((gain == gains[0]).all() for gain in gains)


def test_identify_takes_keywords_or_one_options_object() -> None:
    rng = np.random.default_rng(3)
    u = rng.normal(size=(300, 1))
    y = np.cumsum(u, axis=0)
    options = tl.IdentificationOptions(order=1, method="okid-era", lags=4)
    by_object = tl.identify(u, y, 0.25, options)
    np.testing.assert_array_equal(tl.identify(u, y, 0.25, order=1, method="okid-era", lags=4).model.A, by_object.model.A)
    with pytest.raises(SettingsError, match="order and options are given"):
        tl.identify(u, y, 0.25, options, order=2)
    with pytest.raises(SettingsError, match="no option 'methd'; did you mean method"):
        tl.identify(u, y, 0.25, methd="pbsid")


def test_a_data_frame_keeps_its_column_names() -> None:
    u, y = integrator()
    inputs, outputs = Frame(["left", "right"], u), Frame(["heading", "rate"], y)
    model = tl.identify(inputs, outputs, 0.25, order=2, method="okid-era").model
    assert (model.input_names, model.output_names) == (("left", "right"), ("heading", "rate"))
    with pytest.raises(RecordError, match="u: a column of the data frame holds no numbers"):
        tl.identify(Frame(["left"], np.array([["a"]])), outputs, 0.25)


WAYS = {"order": 2, "method": "okid-era", "lags": 6}
NAMED = {"inputs": ["left", "right"], "outputs": ["heading", "rate"]}


class Table(Frame):
    """A data frame whose columns can be selected by a list of names."""

    def __getitem__(self, names: list[str]) -> "Table":
        return Table(names, self._values[:, [self.columns.index(name) for name in names]])


class Response:
    """Stand-in for python-control's ``TimeResponseData``: one sample per column, one plane per trace."""

    def __init__(self, u: np.ndarray | None, y: np.ndarray, traces: int = 0, dt: float = 0.25) -> None:
        self.t, self.u, self.y, self.ntraces = dt * np.arange(y.shape[-1]), u, y, traces
        self.input_labels, self.output_labels = ["left", "right"], ["heading", "rate"]


def test_a_time_response_has_inputs_outputs_names_and_a_period() -> None:
    u, y = integrator()
    found = tl.identify(Response(u.T, y.T), **WAYS)
    assert (found.model.dt_s, found.model.input_names, found.model.output_names) == (0.25, ("left", "right"), ("heading", "rate"))
    planes = (np.stack([item[:200].T, item[200:].T], axis=1) for item in (u, y))
    halves = tl.identify([u[:200], u[200:]], [y[:200], y[200:]], 0.25, **WAYS).model.A
    np.testing.assert_array_equal(tl.identify(Response(*planes, traces=2), **WAYS).model.A, halves)
    parts = [Response(u[:200].T, y[:200].T), Response(u[200:].T, y[200:].T)]
    np.testing.assert_array_equal(tl.identify(parts, **WAYS).model.A, halves)
    with pytest.raises(RecordError, match="holds no inputs"):
        tl.identify(Response(None, y.T))
    uneven = Response(u.T, y.T)
    uneven.t = uneven.t**2
    with pytest.raises(TreadlineError, match="give even times"):
        tl.identify(uneven)


def test_a_drive_needs_no_names_of_its_columns(tmp_path: Path) -> None:
    u, y = integrator()
    table = np.column_stack([0.25 * np.arange(400), 0.1 * u, 0.1 * y])
    header = "t_s,left_m_s,right_m_s,heading_rad,yaw_rate_rad_s"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=header, comments="")
    model = tl.identify(tmp_path / "log.csv", **WAYS).model
    assert ("t_s", *model.input_names, *model.output_names) == tuple(header.split(","))
    with pytest.raises(SettingsError, match="inputs are named alone"):
        tl.identify(tmp_path / "log.csv", inputs=["left_m_s"])


def test_the_same_record_in_any_form_gives_the_same_model(tmp_path: Path) -> None:
    u, y = integrator()
    expected = tl.identify(u, y, 0.25, **WAYS).model.A
    table = np.column_stack([u, y])
    path = tmp_path / "log.csv"
    path.write_text(
        "t_s,left,right,heading,rate\n"
        + "\n".join(f"{0.25 * k!r},{','.join(map(repr, row))}" for k, row in enumerate(table.tolist()))
    )
    record = InputOutputRecord(u=u, y=y, dt_s=0.25)
    whole = Table(["left", "right", "heading", "rate"], table)
    for found in (
        tl.identify(u.T, y.T, 0.25, channels_first=True, **WAYS),
        tl.identify(u.tolist(), y.tolist(), 0.25, **WAYS),
        tl.identify(record, **WAYS),
        tl.identify(path, **NAMED, **WAYS),
        tl.identify(str(path), **NAMED, **WAYS),
        tl.identify(whole, dt=0.25, **NAMED, **WAYS),
        tl.identify(Response(u.T, y.T), **WAYS),
    ):
        np.testing.assert_array_equal(found.model.A, expected)


def test_a_file_with_a_missing_row_is_read_where_gaps_are_allowed(tmp_path: Path) -> None:
    table = np.column_stack([0.25 * np.arange(400), *integrator()])
    np.savetxt(tmp_path / "log.csv", np.delete(table, 50, axis=0), delimiter=",", header="t_s,left,right,heading,rate", comments="")
    with pytest.raises(TreadlineError, match="pass --allow-gaps"):
        tl.identify(tmp_path / "log.csv", **NAMED, **WAYS)
    found = tl.identify(tmp_path / "log.csv", **NAMED, **WAYS, allow_gaps=True)
    assert found.report.dropped == 7  # the windows that hold the missing row: itself and six lags


def test_lists_are_experiments() -> None:
    u, y = integrator()
    parts = [(u[:150], y[:150]), (u[150:], y[150:])]
    records = [InputOutputRecord(u=a, y=b, dt_s=0.25) for a, b in parts]
    expected = tl.identify(records, **WAYS)
    assert expected.report.samples == 400 - 2 * 6  # the lags of each experiment are not targets
    for given in (list, tuple):
        found = tl.identify(given(a for a, _ in parts), given(b for _, b in parts), 0.25, **WAYS)
        np.testing.assert_array_equal(found.model.A, expected.model.A)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (tl.identify, "dt is missing; give the sampling period in seconds"),
        (lambda u, _: tl.identify(u), "y is missing; give inputs and outputs"),
        (lambda u, y: tl.identify(u.T, y.T, 0.25), "if a row is a channel, give channels_first=True"),
        (lambda u, y: tl.identify(u, y, 0.25, channels_first=True), "if a row is a channel, leave channels_first out"),
        (lambda u, y: tl.identify([u, u], [y], 0.25), "u holds 2 experiments and y 1"),
        (lambda *_: tl.identify("log.csv"), "log.csv: no such file"),
        (lambda u, _: tl.identify(Table(["left", "rigth"], u), dt=0.25, **NAMED), "no column 'right'; did you mean rigth"),
    ],
)
def test_data_in_the_wrong_form_are_refused_with_the_remedy(call: Callable[[Any, Any], Any], message: str) -> None:
    u, y = integrator()
    with pytest.raises(RecordError, match=message):
        call(u, np.column_stack([y, y[:, 0]]) if "row is" in message else y)


def test_a_stair_is_detected_in_a_depth_array_of_any_kind() -> None:
    view = draw_view(np.random.default_rng(1), ViewRecipe(scenes=("up",), heading_deg=(10.0, 20.0)))
    depth = view.frame.depth_m
    found = tl.detect_stair(depth, view.frame.camera, view.gravity_C)
    assert found.accepted
    assert found.heading_rad == pytest.approx(view.stair.heading_rad, abs=np.radians(0.5))
    zeros = np.where(np.isnan(depth), 0.0, depth).astype(float)  # a sensor's zero is no return, too
    assert tl.detect_stair(zeros, view.frame.camera, view.gravity_C.tolist()).heading_rad == found.heading_rad
    with pytest.raises(ImageError, match="3 dimensions"):
        tl.detect_stair(depth[None], view.frame.camera)


def test_a_frame_brings_its_camera_and_gravity_unless_others_are_given() -> None:
    view = draw_view(np.random.default_rng(1), ViewRecipe(scenes=("up",), heading_deg=(10.0, 20.0)))
    named = NamedFrame(name="a", frame=view.frame, mount_known=True, gravity_C=view.gravity_C)
    by_parts = tl.detect_stair(view.frame.depth_m, view.frame.camera, view.gravity_C)
    wide = replace(view.frame.camera, fx_px=250.0, fy_px=250.0)
    for found, same in (
        (tl.detect_stair(named), by_parts),
        (tl.detect_stair(view.frame, gravity=view.gravity_C), by_parts),
        (tl.detect_stair(view.frame), tl.detect_stair(view.frame.depth_m, view.frame.camera)),
        (tl.detect_stair(named, wide), tl.detect_stair(view.frame.depth_m, wide, view.gravity_C)),
    ):
        assert (found.heading_rad, found.sigma_rad) == (same.heading_rad, same.sigma_rad)
    with pytest.raises(ImageError, match="b: a stripe is missing"):
        tl.detect_stair(NamedFrame(name="b", frame=None, mount_known=True, gravity_C=None, reason="a stripe is missing"))


def test_a_camera_may_be_a_file(tmp_path: Path) -> None:
    view = draw_view(np.random.default_rng(1), ViewRecipe(scenes=("up",), heading_deg=(10.0, 20.0)))
    camera = view.frame.camera
    angles = {name: np.degrees(getattr(camera, f"mount_{name}_rad")) for name in ("pitch", "roll", "yaw")}
    mount = "".join(f"mount_{name}_deg = {value}\n" for name, value in angles.items())
    path = write_calibration(tmp_path / "camera.toml", camera, mount)
    one, other = (tl.detect_stair(view.frame.depth_m, given, view.gravity_C) for given in (camera, str(path)))
    assert one.heading_rad == pytest.approx(other.heading_rad, abs=1e-9)  # degrees and back


def test_frames_of_files_go_into_the_detector(tmp_path: Path) -> None:
    view = draw_view(np.random.default_rng(1), ViewRecipe(scenes=("up",), heading_deg=(10.0, 20.0)))
    camera, z = view.frame.camera, view.frame.depth_m
    write_pcd(tmp_path / "a.pcd", points_of_frame(view.frame), (camera.width_px, camera.height_px))
    (named,) = tl.read_frames(tmp_path / "a.pcd")
    found = tl.detect_stair(named, camera, view.gravity_C)
    assert found.heading_rad == tl.detect_stair(z, camera, view.gravity_C).heading_rad
    assert named.frame.camera.fx_px == pytest.approx(camera.fx_px, rel=1e-5)


def test_a_run_has_scores_series_and_a_figure() -> None:
    run = tl.climb(Scenario.model_validate(SHORT), seed=1)
    assert run.verdict == "time_up"
    assert run.scores.duration_s == pytest.approx(0.5)
    assert len(run.series["t_s"]) == len(run.series["heading_deg"])
    assert len(run.plot().axes) > 5
    again = tl.climb(Scenario.model_validate(SHORT), seed=1)
    np.testing.assert_array_equal(run.series["heading_deg"], again.series["heading_deg"])


def test_a_run_is_saved_reported_and_drawn_without_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tl.climb(SHORT)
    named = tl.climb(SHORT, out=tmp_path / "named")
    saved = run.save(tmp_path / "saved")
    same = ("series.csv", "log.mcap")
    assert {path.name for path in saved.iterdir()} == {path.name for path in (tmp_path / "named").iterdir()}
    assert (saved / same[0]).read_bytes() == (named.save(saved) / same[0]).read_bytes()  # replaces the run that is there
    assert "<svg" in run.report(tmp_path / "run.html").read_text()
    assert [axes.get_title("left") for axes in run.plot("pitch_deg", "y_m").axes] == ["phase", "pitch [°]", "y [m]"]
    with pytest.raises(SettingsError, match="no column 'speed'; known here: t_s, "):
        run.plot("speed")
    folder = run.folder
    assert folder is not None
    assert folder.is_dir()
    del run
    gc.collect()
    assert not folder.parent.exists()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(TreadlineError, match="pip install pandas"):
        named.frame()


def test_a_run_opens_in_the_viewer(monkeypatch: pytest.MonkeyPatch) -> None:
    served: list[Any] = []

    def serve(_verb: str, session: Callable[[], Any], *, no_browser: bool) -> None:
        served.append((session(), no_browser))

    monkeypatch.setattr("treadline.view.serving.serve", serve)
    run = tl.climb(SHORT)
    run.view(open_browser=False)
    [(session, no_browser)] = served
    assert (session.run.duration_s, no_browser) == (pytest.approx(0.5, abs=0.011), True)  # within one tick


def test_files_may_be_given_as_tables(tmp_path: Path) -> None:
    chair = tomllib.loads((CHAIRS / "wheelchair.toml").read_text())
    camera = tomllib.loads((CAMERAS / "d455.toml").read_text())
    tables = {"chair": {"model": chair, "payload_kg": 60.0}, "sensors": {"camera": camera}}
    given, named = tl.read_scenario(tables), tl.read_scenario({"chair": {"payload_kg": 60.0}, "sensors": {"camera": "d455"}})
    assert given.read_chair() == named.read_chair()
    assert tl.check(tables).stability_margin_deg == tl.check(named).stability_margin_deg
    spec = tables | {"drive": {"duration_s": 1.0}, "draw": [{"key": "stair.slope_deg", "uniform": [24.0, 28.0]}]}
    (tmp_path / "spec.toml").write_text(read_spec(spec).text)
    assert read_spec(tmp_path / "spec.toml").digest == read_spec(spec).digest
    with pytest.raises(SettingsError, match=r"chair\.model"):
        tl.check({"chair": {"model": chair | {"tracks": {}}}})
    assert tl.detect_ground(np.full((480, 640), 1.5), camera).steps == tl.detect_ground(np.full((480, 640), 1.5), "d455").steps


def test_a_refusal_is_false() -> None:
    assert tl.check("up-28")
    assert not tl.check("up-28", set={"stair.slope_deg": 44})
    assert not tl.climb("up-28", set={"stair.slope_deg": 44})
    assert not tl.detect_stair(np.full((424, 512), 1.5), "kinect2")
    assert tl.climb(SHORT)  # it lasted as long as it was to


def test_a_refused_run_prints_its_reason_and_has_no_figure() -> None:
    run = tl.climb(Scenario.model_validate({"stair": {"slope_deg": 44.0}}))
    assert run.verdict == "refused"
    assert repr(run).startswith("refused: the stair is 44.0° steep")
    with pytest.raises(TreadlineError, match="nothing to plot"):
        run.plot()
    with pytest.raises(TreadlineError, match="no scores"):
        _ = run.scores


def test_what_is_printed_in_a_notebook_is_escaped() -> None:
    model = system(np.eye(1), np.eye(1), np.eye(1), input_names=("<script>",))
    assert "&lt;script&gt;" in model._repr_html_()


def test_a_set_value_holds_in_check_and_climb_and_stands_in_the_manifest(tmp_path: Path) -> None:
    path = tmp_path / "steep.toml"
    path.write_text("[stair]\nslope_deg = 44\n")
    assert tl.check("default", set={"stair.slope_deg": 44, "start.place": "floor"}).reasons == tl.check(path).reasons
    assert tl.check(tl.Scenario(), set={"stair.slope_deg": 44}).verdict == "refuse"
    short = {"drive.duration_s": 0.5, "sensors.camera": "statistical"}
    run = tl.climb("default", set=short, out=tmp_path / "run")
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["settings"]["drive"]["duration_s"] == 0.5
    np.testing.assert_array_equal(run.series["heading_deg"], tl.climb(tl.read_scenario("default", set=short)).series["heading_deg"])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tl.climb(42), r"scenario is of type int; give a file, a shipped name \(default, .*up-28\), a tl.Sc.* or a dict"),
        (lambda: tl.check("up-28", set="stair.steps=8"), "set is 'stair.steps=8'; give values by key"),
        (lambda: tl.climb("up-28", {"K": 1}), "controller: a dict, not a class"),
        (lambda: tl.detect_stair("file.png"), r"for frame in tl.read_frames\('file.png'\): tl.detect_stair\(frame\)"),
        (lambda: tl.detect_stair(np.ones((4, 4))), "a depth image needs its calibration"),
        (lambda: tl.detect_stair(np.ones((4, 4), dtype=np.uint16)), "counts instead of metres"),
        (lambda: tl.tune(np.eye(2)), "model is of type ndarray; tl.identify"),
    ],
)  # fmt: skip
def test_a_wrong_type_is_reported_with_what_to_give(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(TreadlineError, match=message):
        call()


def test_a_model_in_place_of_a_controller_is_to_be_tuned() -> None:
    found = tl.identify(*integrator(), 0.25, order=2, method="okid-era")
    for model in (found, found.model):
        with pytest.raises(SettingsError, match=r"controller is a model; tl.tune\(model\)"):
            tl.climb("default", model)


def test_the_hints_of_public_functions_name_types_that_exist() -> None:
    (block,) = [node for node in ast.parse(inspect.getsource(api)).body if isinstance(node, ast.If)]
    names = dict(vars(api))
    exec(compile(ast.Module(block.body, []), "imports for type checkers", "exec"), names)  # noqa: S102
    for name in ("check", "climb", "identify", "load_model", "read_scenario", "scenarios", "tune"):
        assert Any not in get_type_hints(getattr(api, name), names).values()
    options = {item.name: item.type for item in fields(tl.IdentificationOptions)}
    assert names["IdentificationKeywords"].__annotations__ == options


def test_arrays_take_names_for_their_channels() -> None:
    u = np.random.default_rng(0).normal(size=(200, 2))
    y = 0.1 * np.vstack([np.zeros((1, 2)), np.cumsum(u, axis=0)[:-1]])
    found = tl.identify(u, y, 0.25, inputs=["a", "b"], outputs=["c", "d"], order=2, method="okid-era", lags=2)
    assert (found.model.input_names, found.model.output_names) == (("a", "b"), ("c", "d"))
    with pytest.raises(SettingsError, match="inputs are named alone"):
        tl.identify(u, y, 0.25, inputs=["a", "b"])
    with pytest.raises(RecordError, match="inputs names 1 channels, the data have 2"):
        tl.identify(u, y, 0.25, inputs=["a"], outputs=["c", "d"])
