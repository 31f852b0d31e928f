"""Third-party methods: found by entry point, called with a copy of a solver's inputs, checked, and scored."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers_reports import POINTS, make_dataset

from roundel.cli.main import main
from roundel.scenes.camera.model import Camera
from roundel.scenes.errors import UsageError
from roundel.solver.methods.locate import locate
from roundel.solver.methods.plugin import Found, View, check_found
from roundel.solver.methods.registry import finder_of, installed_methods, load_methods, method_lines
from roundel.solver.photos.photo_report import line_of
from roundel.solver.photos.photographs import solve_photographs
from roundel.solver.pose.circle_pose import poses_from_conic

HOUSE = Path(__file__).resolve().parents[3]
EXAMPLE = HOUSE / "benchmarks" / "peers"
PEERS = HOUSE / ".bench-peers"

IMAGES = """\
schema: 1
name: own
seed: 3
camera: {width_px: 320, height_px: 240, focal_px: 400}
marker: {kind: disc, diameter_m: 0.08}
pose:
  distance_D: {uniform: [4, 6]}
  tilt_deg: {uniform: [20, 45]}
  azimuth_deg: {uniform: [-180, 180]}
  offset_x_px: {uniform: [-40, 40]}
frames: 4
"""
# simittag's s16m with the ID 0x1234, as its own encoder gives it.
TAG = IMAGES.replace(
    "{kind: disc, diameter_m: 0.08}",
    "{kind: coded_rings, diameter_m: 0.08, code: ['111010110010110100010010', '000000000101011110010010', "
    "'000000110001001011010001', '000000001111000010000111']}",
)

OWN = '''
import numpy as np
from roundel.solver.methods.plugin import Found

POSE = [(np.array([0.0, 0.6, -0.8]), np.array([0.0, 0.0, 0.4]))]

def good(view):
    """The true intrinsics, a copy of the image, and the printed size are all that it has."""
    assert view.grey.dtype == np.uint8 and view.camera.K[0, 0] == 400 and view.diameter_m == 0.08
    assert set(view.markers[0]) == {"marker_id", "kind", "diameter_m", "layout"}
    view.image[:] = 0
    view.markers.clear()
    return [Found(poses=POSE)]

def now_and_then(view):
    good.calls = getattr(good, "calls", 0) + 1
    if good.calls == 2:
        raise RuntimeError("two\\nlines")
    if good.calls == 3:
        raise SystemExit(7)
    return [] if good.calls == 4 else [Found(ellipse=[160, 120, 40, 30, 0], confidence=0.5)]

def one_pose(view):
    return [Found(poses=POSE)]

def lies(view):
    return [Found(poses=[(2 * POSE[0][0], POSE[0][1])])]

NOT_CALLABLE = 3
'''


def install(site: Path, name: str, module: str, points: dict[str, str]) -> None:
    """What pip does: a module, and its entry points beside it."""
    site.mkdir(exist_ok=True)
    (site / f"{name}.py").write_text(module)
    info = site / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\nSummary: of a test\n")
    lines = [f"{point} = {value}" for point, value in points.items()]
    (info / "entry_points.txt").write_text("\n".join(["[roundel.methods]", *lines, ""]))


@pytest.fixture
def site(tmp_path, monkeypatch):
    points = {n: f"own_methods:{n}" for n in ("good", "now_and_then", "one_pose", "lies", "NOT_CALLABLE", "absent")}
    folder = tmp_path / "site"
    install(folder, "own_methods", OWN, {**points, "pixels": "own_methods:lies"})
    install(folder, "broken_methods", "import no_such_module\n", {"broken": "broken_methods:find", "twice": "a:b"})
    install(folder, "third_methods", "", {"twice": "c:d"})
    monkeypatch.syspath_prepend(str(folder))
    yield folder
    for name in ("own_methods", "broken_methods", "third_methods"):
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return make_dataset(tmp_path_factory.mktemp("own") / "ds", IMAGES)


def rows_of(folder, method):
    return [r for r in pq.read_table(folder / "estimates.parquet").to_pylist() if r["method"] == method]


def test_what_is_installed_is_listed_and_not_imported(site, capsys):
    listed = {(m.name, m.source) for m in installed_methods()}
    assert {
        ("ml", "roundel"),
        ("blobs", "roundel"),
        ("good", "own_methods 1.0"),
        ("broken", "broken_methods 1.0"),
    } <= listed
    assert any(line.startswith("good ") and line.endswith("of a test") for line in method_lines())
    assert not {"own_methods", "broken_methods"} & set(sys.modules)
    with pytest.raises(SystemExit) as stopped:
        main(["solve", "--list-methods"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out.splitlines() == method_lines()
    # A name of Roundel's own stays Roundel's.
    assert finder_of("pixels") is None


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("goood", "unknown method 'goood'; did you mean good?"),
        ("broken", "'broken' of broken_methods 1.0 cannot be imported from broken_methods:find: ModuleNotFoundError"),
        ("absent", "cannot be imported from own_methods:absent: AttributeError"),
        ("NOT_CALLABLE", "own_methods:NOT_CALLABLE is not callable"),
        ("twice", "offered by broken_methods 1.0 and third_methods 1.0"),
    ],
)
def test_a_method_that_does_not_load_is_one_line(site, dataset, tmp_path, capsys, name, sentence):
    assert main(["solve", str(dataset.path), str(tmp_path / "est"), "--method", name]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1
    with pytest.raises(UsageError):
        load_methods([name])


def test_a_method_of_others_is_solved_and_scored(site, dataset, tmp_path, capsys):
    est, report = tmp_path / "est", tmp_path / "report"
    methods = ["good", "now_and_then", "lies", "blobs"]
    asked = [word for name in methods for word in ("--method", name)]
    assert main(["solve", str(dataset.path), str(est), *asked, "--intrinsics", "true"]) == 0
    said = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
    assert said == [
        "roundel: warning: method now_and_then failed in 2 of the frames; first in frame 1: RuntimeError: two lines",
        "roundel: warning: method lies failed in 4 of the frames; first in frame 0: detection 0: its normal has length "
        "2; give a unit vector",
    ]
    good = rows_of(est, "good")
    assert [(r["frame_id"], r["candidate"], r["chosen"], r["status"]) for r in good] == [
        (i, 0, True, "ok") for i in range(4)
    ]
    assert [r["ellipse_x_px"] for r in good] == [None] * 4
    sometimes = rows_of(est, "now_and_then")
    # An ellipse gives both poses; every frame has its row.
    assert [(r["frame_id"], r["candidate"], r["status"]) for r in sometimes] == [
        (0, 0, "ok"), (0, 1, "ok"), (1, 0, "failed"), (2, 0, "failed"), (3, 0, "failed"),
    ]  # fmt: skip
    assert [r["reason"] for r in sometimes[2:]] == [
        "now_and_then: RuntimeError: two lines", "now_and_then: SystemExit: 7", "now_and_then: nothing found",
    ]  # fmt: skip
    assert (sometimes[0]["edge_sigma_px"], sometimes[0]["confidence"]) == (None, 0.5)
    assert all(r["reason"].startswith("lies: detection 0") for r in rows_of(est, "lies"))
    assert main(["validate", str(dataset.path), str(est), "--out", str(report)]) == 0
    table = [r for r in pq.read_table(report / "scores.parquet").to_pylist() if r["method"] == "blobs"]
    truth = dataset.truth.to_pylist()
    assert len(table) == 4
    for row, true in zip(table, truth, strict=True):
        found = next(r for r in rows_of(est, "blobs") if r["frame_id"] == row["frame_id"])
        point = np.array([found["centre_image_x_px"], found["centre_image_y_px"]])
        image = np.linalg.norm(point - [true["centre_image_x_px"], true["centre_image_y_px"]])
        ellipse = np.linalg.norm(point - [true["ellipse_x_px"], true["ellipse_y_px"]])
        assert (row["detected"], row["solved"], row["reason"]) == (True, False, "found, but without a pose")
        assert row["centre_image_error_px"] == pytest.approx(image, abs=1e-9)
        assert row["oracle_centre_image_error_px"] == pytest.approx(image, abs=1e-9)
        assert row["ellipse_centre_error_px"] == pytest.approx(ellipse, abs=1e-9)
        # The blob's centre is the ellipse's, within a pixel; what tells of a pose is null, not 0.
        assert ellipse < 1
        assert {row[n] for n in ("normal_error_deg", "position_error_m", "reprojection_error_px")} == {None}
        assert row["branch_correct"] is None
    assert "blobs, true: 4 of 4 found without a pose" in capsys.readouterr().out
    rows = csv.DictReader((report / "tables" / "centres.csv").read_text().splitlines())
    centres = next(r for r in rows if r["method"] == "blobs")
    assert (centres["found"], centres["circles"]) == ("4", "4")
    median = np.median([r["ellipse_centre_error_px"] for r in table])
    assert float(centres["ellipse_centre_error_px_median"]) == pytest.approx(median, rel=1e-6)


def test_a_report_of_centres_alone_says_that_it_has_no_poses(dataset, tmp_path):
    assert main(["solve", str(dataset.path), str(tmp_path / "est"), "--method", "blobs", "--intrinsics", "true"]) == 0
    assert main(["validate", str(dataset.path), str(tmp_path / "est"), "--out", str(tmp_path / "report")]) == 0
    html = (tmp_path / "report" / "report.html").read_text()
    assert "Method blobs found 4 of 4 circles in 4 frames" in html
    assert "It gives no poses. The median distance of its centres is" in html
    assert "of 4 circles found by blobs, without a pose" in html
    assert "explain one image of a circle equally well" not in html
    assert "<b>-" not in html


def test_points_are_no_image(tmp_path, capsys):
    points = make_dataset(tmp_path / "points", POINTS.replace("frames_per_cell: 4", "frames_per_cell: 1"))
    assert main(["solve", str(points.path), str(tmp_path / "est"), "--method", "blobs", "--intrinsics", "true"]) == 0
    assert {r["reason"] for r in rows_of(tmp_path / "est", "blobs")} == {
        "blobs: needs an image, but there are only points"
    }


def test_locate_takes_them_too(dataset):
    found = locate(dataset.images.image(0), 0.08, dataset.images.camera(0), method="blobs")
    assert [e.status for e in found] == ["ok"]
    assert found[0].normal is None


def test_photographs_take_them_too(site, dataset, tmp_path):
    photo = tmp_path / "photo.png"
    photo.write_bytes((dataset.path / dataset.images.records[0]["image"]).read_bytes())
    methods = ["pixels", "blobs", "one_pose", "good", "lies"]
    (result,) = solve_photographs(
        [photo], tmp_path / "out", 0.08, methods=methods, intrinsics=["default"], curve="linear"
    )
    assert result.status == "ok"
    by_method = {e.method: e for e in result.estimates}
    assert list(by_method) == methods
    # The blob's centre is the ellipse's, within a pixel.
    assert by_method["blobs"].centre_image == pytest.approx(by_method["pixels"].ellipse[:2], abs=1.0)
    assert by_method["one_pose"].normal.shape == (1, 3)
    assert by_method["good"].reason == "good: AssertionError"  # it asks for another camera
    assert by_method["lies"].reason.startswith("lies: detection 0: its normal has length 2")
    record = json.loads((tmp_path / "out" / "estimates.json").read_text())["photographs"][0]
    shown = {e["method"]: e for d in record["detections"] for e in d["estimates"]}
    assert len(shown["one_pose"]["candidates"]) == 1
    assert shown["blobs"]["centre_image_px"] == pytest.approx(by_method["blobs"].centre_image.tolist())
    # The overlay of a method that gives one pose, or a centre alone.
    for name in ("one_pose", "blobs"):
        (alone,) = solve_photographs([photo], tmp_path / name, 0.08, methods=[name], curve="linear")
        assert (tmp_path / name / alone.overlay).stat().st_size > 0
        assert alone.file in line_of(alone)


def test_a_grid_of_dots():
    # Centres of a drawn grid, 5 by 4 dots of 6 px radius, 24 px apart.
    x, y = np.meshgrid(np.arange(160.0), np.arange(140.0))
    image = np.full(x.shape, 230, dtype=np.uint8)
    centres = [(30 + 24 * i, 30 + 24 * j) for j in range(4) for i in range(5)]
    for cx, cy in centres:
        image[np.hypot(x - cx, y - cy) < 6] = 20
    camera = Camera(160, 140, np.array([[200.0, 0, 79.5], [0, 200.0, 69.5], [0, 0, 1]]))
    view = View(image, camera, 0.01, [{"marker_id": 0, "kind": "dots", "layout": {"columns": 5, "rows": 4}}])
    found = finder_of("circles_grid")(view)
    points = np.array([f.centre_px for f in found])
    away = np.linalg.norm(points[:, None] - np.array(centres), axis=-1).min(axis=0)
    assert len(points) == 20
    assert away.max() < 0.2  # the threshold's steps, on an image without grey edges
    assert finder_of("circles_grid")(View(image, camera, 0.01)) == []


CAMERA = Camera(320, 240, np.array([[400.0, 0, 159.5], [0, 400.0, 119.5], [0, 0, 1]]))
VIEW = View(np.zeros((240, 320), dtype=np.uint8), CAMERA, 0.08)
N, C = [0.0, 0.6, -0.8], [0.0, 0.0, 0.4]


@pytest.mark.parametrize(
    ("found", "sentence"),
    [
        ({"x": 1}, "it is a dict, not a roundel.solver.methods.plugin.Found"),
        (Found(), "neither a pose nor an ellipse nor a centre"),
        (Found(poses=[(N, C)] * 3), "it has 3 poses"),
        (Found(poses=[N]), "its poses are not pairs|its normal has shape|too many values"),
        (Found(poses=[(N, [0, 0])]), r"its centre_m has shape \(2,\), not \(3,\)"),
        (Found(poses=[(["a", 0, 0], C)]), "its normal must be 3 numbers"),
        (Found(poses=[(N, [0, 0, np.nan])]), "its centre_m is not finite"),
        (Found(poses=[(N, [0, 0, -0.4])]), "behind the camera"),
        (Found(poses=[([0.0, -0.6, 0.8], C)]), "points away from the camera"),
        (Found(poses=[(N, [0, 0, 400.0])]), "is its centre in metres?"),
        (Found(poses=[(N, C)], chosen=1), "chosen is 1, but it has 1 poses"),
        (Found(ellipse=[1, 2, 3, 4, 5]), "a >= b > 0"),
        (Found(centre_px=(1, np.inf)), "its centre_px is not finite"),
        (Found(centre_px=(1, 2), confidence=2), "from 0 to 1"),
    ],
)
def test_answers_that_cannot_be(found, sentence):
    with pytest.raises(ValueError, match=sentence):
        check_found(found, VIEW)


def test_candidates_come_in_the_order_of_the_conventions():
    from roundel.scenes.geometry.conic import conic_of_ellipse

    poses = poses_from_conic(conic_of_ellipse([180.0, 100.0, 40.0, 30.0, 20.0]), CAMERA.K, 0.04)
    both = list(zip(poses.normal, poses.centre_m, strict=True))
    for order in ([0, 1], [1, 0]):
        checked = check_found(Found(poses=[both[i] for i in order], chosen=0), VIEW)
        np.testing.assert_array_equal(checked.normal, poses.normal)
        assert checked.chosen == order[0]


@pytest.mark.skipif(
    not (PEERS / "roundel_peers").is_dir() or not (PEERS / "simittag").is_dir(),
    reason="simittag is not installed (make peers-env)",
)
def test_simittag_decodes_its_own_tags_and_is_scored(tmp_path):
    """In a process of its own, as a user runs it: simittag and its companions stay out of this one."""
    folder = make_dataset(tmp_path / "ds", TAG).path
    script = (
        f"import sys\nsys.path[:0] = [{str(EXAMPLE)!r}]\nsys.path += [{str(PEERS)!r}]\n"
        "from roundel.cli.main import main\n"
        f"code = main(['solve', {str(folder)!r}, 'est', '--method', 'simittag', '--intrinsics', 'true'])\n"
        f"sys.exit(code or main(['validate', {str(folder)!r}, 'est', '--out', 'report']))\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert run.returncode == 0, run.stderr
    rows = pq.read_table(tmp_path / "report" / "scores.parquet").to_pylist()
    assert [(r["method"], r["solved"], r["branch_correct"]) for r in rows] == [("simittag", True, True)] * 4
    # Its paper promises some hundredths of a degree; a wrong branch or a sign would be tens of degrees.
    assert max(r["normal_error_deg"] for r in rows) < 1.0
    assert max(r["position_error_pct"] for r in rows) < 1.0
