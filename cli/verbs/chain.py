"""The verbs from a study to its report, and those that other modules carry out: each is a few lines."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from functools import partial
from pathlib import Path
from typing import Any

from roundel.cli.plausibility import implausible_arguments
from roundel.cli.progress import progress
from roundel.cli.verbs.studies import find_study, init_study, list_studies
from roundel.scenes.camera.intrinsics_label import IntrinsicsLabel
from roundel.scenes.errors import UsageError


def do_check(arguments: argparse.Namespace) -> int:
    """Read a study, sample every frame, print it resolved."""
    if arguments.schema:
        from roundel.scenes.study.schema import json_schema

        print(json.dumps(json_schema(), indent=2))
        return 0
    if arguments.study is None:
        raise UsageError("check: give a STUDY or --schema")
    from roundel.cli.cost import cost_of
    from roundel.datasets.records import study_bytes

    study = _study(arguments.study)
    if arguments.cache_key:
        from roundel.datasets.environment import cache_key

        print(cache_key(study.digest()))
        return 0
    with progress("check") as show:
        cost = cost_of(study, partial(show, step="check"))
    print(study_bytes(study).decode(), end="")
    print(f"# dataset_id {study.digest()}")
    for line in cost:
        print(f"# {line}")
    return 0


def do_preview(arguments: argparse.Namespace) -> int:
    """Show a few frames of a study before it is rendered."""
    from roundel.cli.verbs.preview import preview

    return preview(_study(arguments.study), arguments)


def _study(path: str) -> Any:
    """Load a study, check its methods and intrinsics before the rendering starts, and warn of implausible values."""
    from roundel.scenes.study.study import load_study
    from roundel.scenes.world.plausibility import implausible_values
    from roundel.solver.ambiguity.parse_prior import parse_knowledge
    from roundel.solver.intrinsics.plausibility import describe_implausible_focal
    from roundel.solver.intrinsics.specification import parse_intrinsics
    from roundel.solver.methods.registry import load_methods

    path = str(find_study(path))
    study = load_study(path)
    line, column = study.marks.get(("solve",), (1, 1))
    try:
        load_methods(study.solve.methods)
        parse_knowledge(study.solve.knowledge)
        specs = [parse_intrinsics(label) for label in study.solve.intrinsics if not _is_of_study(label)]
    except UsageError as error:
        raise UsageError(f"{path}:{line}:{column}: solve: {error}") from error
    odd = filter(None, map(describe_implausible_focal, specs))
    for warning in [*implausible_values(study), *(f"{path}:{line}:{column}: solve: {one}" for one in odd)]:
        _warn(warning)
    return study


def _is_of_study(label: str) -> bool:
    """Whether intrinsics are calibrated from the study's own boards instead of read from a camera file."""
    return label == "calibrated" or IntrinsicsLabel.of(label).views is not None


def _room_for(study: Any, address: str | Path) -> None:
    from roundel.cli.cost import disk_bytes
    from roundel.datasets.store.addresses import is_url

    if is_url(address):
        return  # nothing tells how much a store has left
    out = Path(address)
    folder = next(p for p in (out, *out.absolute().parents) if p.exists())
    free, needed = shutil.disk_usage(folder).free, disk_bytes(study)
    if needed > free:
        print(
            f"roundel: warning: {folder} has {free / 1e9:.2g} GB free, this study may need {needed / 1e9:.2g} GB",
            file=sys.stderr,
        )


def do_studies(arguments: argparse.Namespace) -> int:
    """List the shipped studies, or print one."""
    return list_studies(arguments)


def do_init(arguments: argparse.Namespace) -> int:
    """Write a commented study to start from."""
    return init_study(arguments)


def do_render(arguments: argparse.Namespace) -> int:
    """Render a study to a dataset."""
    study, out = _study(arguments.study), arguments.dataset
    _room_for(study, out)
    wanted = _wanted(study, arguments)
    dataset = _rendered(study, out, arguments, wanted)
    if dataset is None:
        from roundel.cli.verbs.datasets import warn_of_unfinished

        warn_of_unfinished(study, out, wanted)
        print(f"{out}: some frames are missing; run `roundel render` without --frames to complete the dataset")
    else:
        _warn_of_flags(dataset)
        print(f"{out}: {len(dataset)} frames, dataset_id {dataset.manifest['dataset_id'][:12]}")
        _print_fidelity(dataset.manifest)
    return 0


def _rendered(study: Any, dataset: str | Path, arguments: argparse.Namespace, frames: range | None) -> Any:
    from roundel.render.run import render_study

    with progress("render") as show:
        return render_study(
            study,
            dataset,
            jobs=arguments.jobs,
            threads=arguments.threads,
            scheduler=arguments.scheduler,
            backend=arguments.backend,
            frames=frames,
            mix_environments=arguments.mix_environments,
            progress=show,
            check_progress=partial(show, step="check"),
            on_warning=_warn,
        )


def do_develop(arguments: argparse.Namespace) -> int:
    """Develop (re-expose) a dataset's radiance with another sensor."""
    from roundel.render.redevelop import develop_dataset

    with progress("develop") as show:
        dataset = develop_dataset(
            arguments.dataset,
            arguments.out,
            arguments.sensor,
            show,
            on_warning=_warn,
            jobs=arguments.jobs,
            scheduler=arguments.scheduler,
            keep_radiance=not arguments.no_radiance,
        )
    _warn_of_flags(dataset)
    identity, source = (str(dataset.manifest[key])[:12] for key in ("dataset_id", "developed_from"))
    frames = f"{len(dataset)} frames{_levels(dataset)}"
    print(f"{arguments.out}: {frames}, dataset_id {identity}, developed from {source}")
    return 0


def _levels(dataset: Any) -> str:
    """The swept keys of a dataset and the numbers of their levels, in brackets."""
    swept = [group["sweep"] for group in dataset.study["groups"].values() if group.get("sweep")]
    texts = dict.fromkeys(f"{len(sweep['levels'])} levels of {sweep['key']}" for sweep in swept)
    return f" ({', '.join(texts)})" if texts else ""


def _warn_of_flags(dataset: Any) -> None:
    """One line on stderr if frames of a dataset are flagged."""
    from roundel.datasets.flags import flags_of_rows, warning_of

    if any(dataset.manifest["counts"].get("flags", {}).values()):
        rows = (row for table in dataset.truths() for row in table.select(["frame_id", "flags"]).to_pylist())
        line = warning_of(flags_of_rows(rows), len(dataset))
        if line:
            _warn(line)


def _wanted(study: Any, arguments: argparse.Namespace) -> range | None:
    """The frames that --frames or --slice name."""
    from roundel.scenes.world.frame import total_frames

    if arguments.slice is None:
        return None if arguments.frames is None else arguments.frames
    if arguments.frames is not None:
        raise UsageError("--slice: give either --frames or --slice")
    number, count = arguments.slice
    total = total_frames(study)
    return range((number - 1) * total // count, number * total // count)


def _print_fidelity(manifest: dict[str, Any]) -> None:
    from roundel.datasets.fidelity.summary import fidelity_lines

    print("\n".join(fidelity_lines(manifest.get("fidelity"))))


def do_solve(arguments: argparse.Namespace) -> int:
    """Estimate poses from a dataset's images, from photographs, or from a video."""
    from roundel.cli.verbs.photos import are_photographs, is_video, solve_film, solve_photos

    for warning in implausible_arguments(arguments):
        _warn(warning)
    if is_video(arguments.inputs):
        return solve_film(arguments, _knowledge(arguments.knowledge))
    if are_photographs(arguments.inputs):
        return solve_photos(arguments, _knowledge(arguments.knowledge))
    if arguments.diameter_m is not None or arguments.curve is not None:
        option = "--diameter-m" if arguments.curve is None else "--curve"
        raise UsageError(f"{option}: a dataset defines its own markers and sensor; leave it out")
    from roundel.cli.verbs.datasets import readable
    from roundel.datasets.layout.images import open_images
    from roundel.datasets.layout.manifest import read_manifest
    from roundel.datasets.store.addresses import store_at
    from roundel.solver.methods.solve import solve_dataset

    dataset = readable(arguments.inputs[0])
    # Opened first: for a folder that is not a dataset, this error is clearer than that of the missing study.
    groups = open_images(dataset).group_names
    wanted = read_manifest(store_at(dataset))[0]["study"].get("solve", {})
    chosen = arguments.group or wanted.get("groups")
    for group in chosen or []:
        if group not in groups:
            raise UsageError(f"--group {group}: the dataset has {', '.join(groups)}")
    intrinsics = arguments.intrinsics or [
        label for label in wanted.get("intrinsics", ["true"]) if not _is_of_study(label)
    ]
    with progress("solve") as show:
        counts = solve_dataset(
            dataset,
            Path(arguments.out),
            methods=tuple(arguments.method or wanted.get("methods", ["pixels"])),
            intrinsics=tuple(intrinsics or ["true"]),
            groups=chosen,
            frames=arguments.frames,
            knowledge=_knowledge(arguments.knowledge or wanted.get("knowledge")),
            progress=show,
            on_warning=_warn,
            jobs=arguments.jobs,
            scheduler=arguments.scheduler,
        )
    print(f"{arguments.out}: {_counted(counts)}")
    return 0


def _warn_of_conventions(summary: Any) -> None:
    """One line on stderr, before the scores, for each convention that the estimates seem to have by mistake."""
    from roundel.scenes.display_text import clean

    for diagnosis in summary.diagnoses:
        _warn(clean(diagnosis["sentence"]))


def _warn(line: str) -> None:
    print(f"roundel: warning: {line}", file=sys.stderr)


def _knowledge(text: str | None) -> Any:
    from roundel.solver.ambiguity.parse_prior import parse_knowledge

    return None if text is None else parse_knowledge(text)


def _counted(counts: Any) -> str:
    return ", ".join(f"{value} {name.replace('_', ' ')}" for name, value in dict(counts).items())


def do_validate(arguments: argparse.Namespace) -> int:
    """Score estimates."""
    from roundel.cli.verbs.datasets import readable
    from roundel.datasets.dataset import open_dataset
    from roundel.validate.scores.terminal_table import terminal_table
    from roundel.validate.validate import validate_dataset

    asked = open_dataset(readable(arguments.dataset)).study.get("validate", {})
    extent = arguments.extent_D or asked.get("reprojection_extent_D", 3.0)
    out = Path(arguments.out)
    with progress("chessboards") as show:
        summary = validate_dataset(
            arguments.dataset,
            arguments.estimates,
            out,
            extent_D=extent,
            camera_path=arguments.camera,
            progress=show,
            jobs=arguments.jobs,
            scheduler=arguments.scheduler,
        )
    _warn_of_conventions(summary)
    print(terminal_table(summary))
    if "reference" in summary.dataset:
        print(summary.dataset["reference"]["sentence"])
    print(f"report: {out / 'report.html'}")
    return 0


def do_run(arguments: argparse.Namespace) -> int:
    """Render, solve, validate."""
    from roundel.cli.verbs.calibrate import calibrate_of_study
    from roundel.solver.methods.registry import load_methods
    from roundel.solver.methods.solve import solve_dataset
    from roundel.validate.scores.terminal_table import terminal_table
    from roundel.validate.validate import validate_dataset

    study, out = _study(arguments.study), Path(arguments.out)
    methods = arguments.method or study.solve.methods
    load_methods(methods)  # a wrong name ends the command before anything is rendered
    _room_for(study, out)
    dataset = _rendered(study, out / "dataset", arguments, None)
    assert dataset is not None, "a run without --frames finishes its dataset"
    _warn_of_flags(dataset)
    _print_fidelity(dataset.manifest)
    camera: Path | None = None
    labels = study.solve.intrinsics
    if study.solve.calibrate_from is not None:
        lines, camera, files = calibrate_of_study(study, out)
        print("\n".join(lines))
        labels = [f"calibrated:{files[label]}" if label in files else label for label in labels]
    if not _has_circles(dataset, study.solve.groups):
        print(f"no circular markers to solve; finished: {camera or out / 'dataset'}")
        return 0
    with progress("solve") as show:
        solve_dataset(
            out / "dataset",
            out / "estimates",
            methods=tuple(methods),
            intrinsics=tuple(labels),
            groups=study.solve.groups,
            knowledge=_knowledge(study.solve.knowledge),
            progress=show,
            on_warning=_warn,
            jobs=arguments.jobs,
            scheduler=arguments.scheduler,
        )
    with progress("chessboards") as show:
        summary = validate_dataset(
            out / "dataset",
            [out / "estimates"],
            out / "report",
            extent_D=study.validate.reprojection_extent_D,
            camera_path=camera,
            progress=show,
        )
    _warn_of_conventions(summary)
    print(terminal_table(summary))
    print(f"report: {out / 'report' / 'report.html'}")
    return 0


def _has_circles(dataset: Any, groups: list[str] | None) -> bool:
    table = dataset.truth
    rows = zip(table["group"].to_pylist(), table["radius_m"].to_pylist(), strict=True)
    return any(radius is not None and (groups is None or group in groups) for group, radius in rows)


def do_calibrate(arguments: argparse.Namespace) -> int:
    """Calibrate from boards."""
    from roundel.cli.verbs.calibrate import calibrate

    for warning in implausible_arguments(arguments):
        _warn(warning)
    return calibrate(arguments)


def do_marker(arguments: argparse.Namespace) -> int:
    """Print a marker."""
    from roundel.cli.verbs.photos import print_marker

    return print_marker(arguments)


def do_doctor(arguments: argparse.Namespace) -> int:
    """Print versions, backend and missing packages."""
    from roundel.cli.doctor import examine

    lines, well = examine()
    for line in lines:
        print(line)
    return 0 if well else 4


def do_completion(arguments: argparse.Namespace) -> int:
    """Print the script that completes the command in a shell."""
    from roundel.cli.completion import script

    print(script(arguments.shell), end="")
    return 0
