"""The algebraic related systems: exact recovery, and errors under noise beside the standard deviations they state.

    python benchmarks/related/related_systems.py [--scenes 500] [--trials 200] [--data FOLDER] [--markdown FILE]

Exact: images of circles without noise, 500 random scenes a system; the largest relative error. Noise: ellipses fitted
to one point a pixel of each contour, moved by isotropic Gaussian noise; each system's own measurement of the focal
length, alone and fused with a prior of 11.5 % about the truth. Images: markers rendered without blur, with the noise of
10,000 electrons, at four sizes (`related_images.py`); the datasets stay in FOLDER. The scenes are those of the tests
(tests/helpers/helpers_circles.py).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/helpers"))

from helpers_circles import CircleScene, circle_scene, noisy_ellipses, scattered  # noqa: E402
from related_images import SIZES_PX, image_tables, markdown_table  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

from roundel.scenes.camera.focal_fusion import fused_focal_px  # noqa: E402
from roundel.scenes.geometry.conic import ellipse_of_conic, ellipse_points  # noqa: E402
from roundel.scenes.geometry.pose import angle_deg  # noqa: E402
from roundel.solver.fit.guaranteed_fit import guaranteed_ellipse  # noqa: E402
from roundel.solver.pose.circle_pose import poses_from_ellipse  # noqa: E402
from roundel.solver.pose.focal_uncertainty import MeasuredFocal  # noqa: E402
from roundel.solver.pose.plane_homography import fit_homography  # noqa: E402
from roundel.solver.pose.pose_covariance import poses_with_covariance  # noqa: E402
from roundel.solver.related import chen2004, gurdjos2006, huang2015, kim2005, pollefeys1999, wu2004  # noqa: E402
from roundel.solver.related.szpak2015 import confidence_band  # noqa: E402
from roundel.solver.views.dual_circular_points import normal_from_line  # noqa: E402
from roundel.solver.views.plane_of_view import LARGEST_SIGMA, focal_of_fit  # noqa: E402

Array = NDArray[np.float64]

PRIOR = 0.115
NOISE_PX = (0.02, 0.1, 0.3)
DISCS = np.array([[0.0, 0.0], [1.5, 0.0]]), np.array([0.5, 0.5])
RING = np.zeros((2, 2)), np.array([0.5, 0.25])
_TURN = np.arange(6) * np.pi / 3
DOTS = 2.0 * (np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1) - [1.0, 0.0]), np.full(6, 0.5)
VIEWS = 4


def _normal_error(normal: Array, scene: CircleScene) -> float:
    return float(np.radians(angle_deg(normal, scene.normal)))


def exact_wu(generator: np.random.Generator) -> dict[str, float]:
    scene = circle_scene(generator, *scattered(generator, 2))
    poses = wu2004.both_poses(scene.conics, scene.K, scene.radii_m)
    chosen = wu2004.most_parallel(poses.normal).chosen
    centre = poses.centre_m[[0, 1], chosen] - scene.poses[:, :3, 3]
    distance = np.linalg.norm(scene.poses[:, :3, 3], axis=1)
    return {
        "normal": max(_normal_error(poses.normal[i, chosen[i]], scene) for i in range(2)),
        "centre": float(np.max(np.linalg.norm(centre, axis=1) / distance)),
    }


def exact_chen(generator: np.random.Generator) -> dict[str, float]:
    scene = circle_scene(generator, *scattered(generator, 2))
    plane = chen2004.planes_of_circles(scene.conics, scene.K[:2, 2])[0]
    return {
        "focal length": abs(plane.focal_px / scene.K[0, 0] - 1.0),
        "normal": _normal_error(plane.normal, scene),
        "centre": float(np.abs(plane.centre_image_px - scene.centre_px).max() / scene.K[0, 0]),
    }


def exact_kim(generator: np.random.Generator) -> dict[str, float]:
    scene = circle_scene(generator, np.zeros((2, 2)), np.array([0.5, generator.uniform(0.1, 0.45)]))
    pair = kim2005.concentric_pair(*scene.conics)
    return {
        "focal length": abs(kim2005.focal_of_concentric(*scene.conics, scene.K[:2, 2]) / scene.K[0, 0] - 1.0),
        "normal": _normal_error(normal_from_line(pair.line, scene.K), scene),
        "centre": float(np.abs(pair.centre_px - scene.centre_px[0]).max() / scene.K[0, 0]),
    }


def exact_gurdjos(generator: np.random.Generator) -> dict[str, float]:
    scene = circle_scene(generator, *scattered(generator, int(generator.integers(2, 6)), gap=0.1))
    points = gurdjos2006.circular_points_of_circles(scene.conics)[0]
    return {
        "focal length": abs(points.focal_px(scene.K[:2, 2]) / scene.K[0, 0] - 1.0),
        "normal": _normal_error(normal_from_line(points.line, scene.K), scene),
    }


def exact_huang(generator: np.random.Generator) -> dict[str, float]:
    """The whole calibration matrix: five numbers."""
    f, ratio = generator.uniform(700, 2000), generator.uniform(0.3, 0.8)
    scenes = [
        circle_scene(
            generator, np.zeros((2, 2)), np.array([0.5, 0.5 * ratio]), (20, 65), focal_px=f, principal_point=(640, 480)
        )
        for _ in range(int(generator.integers(3, 7)))
    ]
    conics = np.array([scene.conics for scene in scenes])
    found = huang2015.calibration_of_views(conics[:, 0], conics[:, 1])
    return {"calibration matrix": float(np.abs(found - scenes[0].K).max() / f)}


def exact_pollefeys(generator: np.random.Generator) -> dict[str, float]:
    """Projective reconstructions of three to seven views, each with another focal length."""
    count = int(generator.integers(3, 8))
    focal, frame = generator.uniform(700, 2000, count), generator.normal(size=(4, 4))
    turns = Rotation.from_rotvec(generator.uniform(-0.6, 0.6, (count, 3))).as_matrix()
    projections = []
    for f, turn in zip(focal, turns, strict=True):
        k = np.array([[f, 0.0, 639.5], [0.0, f, 479.5], [0.0, 0.0, 1.0]])
        projections.append(k @ np.column_stack([turn, generator.uniform([-1, -1, 3], [1, 1, 5])]) @ frame)
    found = pollefeys1999.calibrations(np.array(projections), (639.5, 479.5))
    return {"focal length": float(np.abs(found[:, 0, 0] / focal - 1.0).max())}


def exact_szpak(generator: np.random.Generator) -> dict[str, float]:
    ellipse = ellipse_of_conic(circle_scene(generator, np.zeros((1, 2)), np.array([0.5])).conics[0])
    fit = guaranteed_ellipse(ellipse_points(ellipse, 40))
    return {"ellipse": float(np.abs(fit.ellipse[:4] - ellipse[:4]).max() / ellipse[2])}


EXACT = {
    "wu2004": exact_wu,
    "chen2004": exact_chen,
    "kim2005": exact_kim,
    "gurdjos2006": exact_gurdjos,
    "huang2015": exact_huang,
    "pollefeys1999": exact_pollefeys,
    "szpak2015": exact_szpak,
}


def focal_chen(generator: np.random.Generator, sigma_px: float, focal: float) -> MeasuredFocal | None:
    scene = circle_scene(generator, *DISCS, focal_px=focal)
    return focal_of_fit(chen2004.measured_plane(*noisy_ellipses(generator, scene, sigma_px), scene.K))


def focal_gurdjos(generator: np.random.Generator, sigma_px: float, focal: float) -> MeasuredFocal | None:
    scene = circle_scene(generator, *DISCS, focal_px=focal)
    return gurdjos2006.measured_focal(*noisy_ellipses(generator, scene, sigma_px), scene.K)


def _ring(generator: np.random.Generator, sigma_px: float, focal: float) -> tuple[list[SimpleNamespace], Array]:
    scene = circle_scene(generator, *RING, focal_px=focal, principal_point=(639.5, 479.5))
    ellipses, covs = noisy_ellipses(generator, scene, sigma_px)
    return [SimpleNamespace(ellipse=e, shape_cov=c) for e, c in zip(ellipses, covs, strict=True)], scene.K


def focal_kim(generator: np.random.Generator, sigma_px: float, focal: float) -> MeasuredFocal | None:
    return focal_of_fit(kim2005.measured_pair(*_ring(generator, sigma_px, focal)))


def focal_huang(generator: np.random.Generator, sigma_px: float, focal: float) -> MeasuredFocal | None:
    rings = [_ring(generator, sigma_px, focal) for _ in range(VIEWS)]
    return huang2015.focal_of_pairs([pair for pair, _ in rings], rings[0][1])


def focal_pollefeys(generator: np.random.Generator, sigma_px: float, focal: float) -> MeasuredFocal | None:
    planes = []
    for _ in range(VIEWS):
        scene = circle_scene(generator, *DOTS, distance=(20, 80), focal_px=focal, principal_point=(639.5, 479.5))
        planes.append(fit_homography(*noisy_ellipses(generator, scene, sigma_px), DOTS[0], DOTS[1]))
    return pollefeys1999.shared_focal(planes, scene.K)


FOCAL: dict[str, tuple[str, Callable[[np.random.Generator, float, float], MeasuredFocal | None]]] = {
    "chen2004": ("two discs", focal_chen),
    "gurdjos2006": ("two discs", focal_gurdjos),
    "kim2005": ("a ring", focal_kim),
    "huang2015": (f"a ring, {VIEWS} views", focal_huang),
    "pollefeys1999": (f"six dots, {VIEWS} views", focal_pollefeys),
}


def exact_table(scenes: int) -> str:
    rows = []
    for name, recover in EXACT.items():
        generator = np.random.default_rng(15)
        errors = [recover(generator) for _ in range(scenes)]
        for what in errors[0]:
            values = np.array([error[what] for error in errors])
            rows.append([name, what, str(scenes), f"{values.max():.1e}", f"{np.median(values):.1e}"])
    return markdown_table(["system", "recovered", "scenes", "largest error", "median error"], rows)


def noise_table(trials: int) -> str:
    header = ["system", "print", "noise, px", "trials", "stated, %", "median sigma, %", "RMS error / sigma"]
    header += ["in 95 % interval, %", "fused: median, RMS, %", "prior alone: median, RMS, %"]
    rows = []
    for name, (print_, measure) in FOCAL.items():
        for sigma_px in NOISE_PX:
            generator = np.random.default_rng(16)
            ratios, sigmas, fused, alone = [], [], [], []
            count = trials // 2 if "views" in print_ else trials
            for _ in range(count):
                focal = generator.uniform(700.0, 2000.0)
                prior = focal * np.exp(generator.normal(0.0, PRIOR))
                alone.append(np.log(prior / focal))
                try:
                    found = measure(generator, sigma_px, focal)
                except ValueError:
                    found = None
                if found is None or not found.sigma <= LARGEST_SIGMA:
                    fused.append(alone[-1])
                    continue
                ratios.append(np.log(found.focal_px / focal) / found.sigma)
                sigmas.append(found.sigma)
                both, _ = fused_focal_px(prior, PRIOR, found.focal_px, found.sigma * found.focal_px)
                fused.append(np.log(both / focal))
            ratio = np.array(ratios)
            rows.append(
                [
                    name,
                    print_,
                    f"{sigma_px:g}",
                    str(count),
                    f"{100 * len(ratio) / count:.0f}",
                    f"{100 * np.median(sigmas):.2f}" if len(ratio) else "-",
                    f"{np.sqrt(np.mean(ratio**2)):.2f}" if len(ratio) else "-",
                    f"{100 * np.mean(np.abs(ratio) < 1.96):.0f}" if len(ratio) else "-",
                    _median_rms(fused),
                    _median_rms(alone),
                ]
            )
            print(*rows[-1], sep=" | ", file=sys.stderr, flush=True)
    return markdown_table(header, rows)


def _median_rms(errors: list[float]) -> str:
    values = 100 * np.abs(errors)
    return f"{np.median(values):.2f}, {np.sqrt(np.mean(values**2)):.2f}"


def known_camera_table(trials: int) -> str:
    """Wu and Szpak measure no focal length: normals of two discs, and bands about one ellipse."""
    rows = []
    for sigma_px in NOISE_PX:
        generator = np.random.default_rng(17)
        errors, stated, wrong, held = [], [], 0, []
        for _ in range(trials):
            scene = circle_scene(generator, *DISCS)
            ellipses, covs = noisy_ellipses(generator, scene, sigma_px)
            normals = poses_from_ellipse(ellipses, scene.K, 1.0).normal
            chosen = int(wu2004.most_parallel(normals, 180.0).chosen[0])
            nearer = int(np.argmax(normals[0] @ scene.normal))
            wrong += chosen != nearer
            _, cov = poses_with_covariance(ellipses[0], covs[0], scene.K, 1.0)
            errors.append(_normal_error(normals[0, nearer], scene))
            stated.append(float(np.trace(cov[nearer, 3:, 3:])))
            ellipse = ellipse_of_conic(scene.conics[0])
            points = ellipse_points(ellipse, max(12, int(6 * ellipse[2])))
            fit = guaranteed_ellipse(points + generator.normal(0.0, sigma_px, points.shape))
            band = confidence_band(fit)
            from roundel.solver.fit.ellipse_distance import foot_points

            held.append(np.all(np.abs(foot_points(ellipse, band.contour_px)[0]) <= band.half_width_px))
        ratio = np.sqrt(np.mean(np.square(errors)) / np.mean(stated))
        rows.append(
            [
                f"{sigma_px:g}",
                str(trials),
                f"{np.degrees(np.median(errors)):.3f}",
                f"{ratio:.2f}",
                f"{100 * (1 - wrong / trials):.1f}",
                f"{100 * np.mean(held):.1f}",
            ]
        )
    header = ["noise, px", "trials", "wu2004: median normal error, deg", "RMS error / sigma"]
    header += ["nearer normal chosen, %", "szpak2015: ellipse in its 95 % band, %"]
    return markdown_table(header, rows)


PAGE = """# The algebraic related systems

`python benchmarks/related/related_systems.py --markdown FILE` wrote this page.

## Exact circles

Relative errors: of the focal length; of the normal, in radians; of the centre, over its distance or, as an image, over
the focal length; of all elements of the calibration matrix over the focal length; of the ellipse over its semi-axis.

{exact}

## Noisy circles

Diameters of 28 to 330 px (f of 700 to 2000 px, 6 to 25 diameters away), tilts of 12 to 65 degrees; the dots of
pollefeys1999 are a third as large. *Stated*: the system gives a focal length at all, that is, its sigma of log f is
at most {largest:.2f}. The prior is normal in log f with 11.5 %. kim2005 and huang2015 add a floor of 0.002 px to each
covariance, as on images, which is most of it at a noise of 0.02 px.

{noise}

With a known camera (sigma as the covariance of the pose has it):

{known}

## Rendered markers

{images}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--scenes", type=int, default=500)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--frames", type=int, default=40, help="of each marker and size")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES_PX, help="semi-axes, px")
    parser.add_argument("--data", type=Path, default=ROOT / "out/bench-related", help="folder of the datasets")
    parser.add_argument("--markdown", type=Path, help="write the page to this file instead of printing it")
    arguments = parser.parse_args()
    page = PAGE.format(
        exact=exact_table(arguments.scenes),
        noise=noise_table(arguments.trials),
        known=known_camera_table(arguments.trials),
        images=image_tables(arguments.data, arguments.frames, arguments.sizes),
        largest=LARGEST_SIGMA,
    )
    if arguments.markdown:
        arguments.markdown.write_text(page, encoding="utf-8")
    else:
        print(page)


if __name__ == "__main__":
    main()
