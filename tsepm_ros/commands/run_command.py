"""The command `tsepm run`: a recording, a bag or a simulated scenario, from messages to tracks."""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import ExitStack
from pathlib import Path

from tsepm_ros.commands.arguments import in_folder
from tsepm_ros.commands.failure import CommandFailed
from tsepm_ros.commands.run_sources import Run, add_source_arguments, needs_scene, open_run
from tsepm_ros.pictures.run_scene import RunScene, ScanView
from tsepm_ros.progress import named_progress, with_progress
from tsepm_ros.replay.track_files import CurrentTable, TrackBag, TrackTable, TrackWriter
from tsepm_ros.replay.track_listing import TrackListing
from tsepm_ros.session.drop_reasons import reason_of
from tsepm_ros.session.losses import explained
from tsepm_ros.viewer.page_files import write_page
from tsepm_ros.viewer.recorded_scene import RecordedScene
from tsepm_ros.whole_files import naming, opened_whole


def add_recording_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `tsepm run`."""
    add_source_arguments(parser)
    parser.add_argument(
        "--out",
        type=in_folder,
        help="folder for tracks.csv, current.csv (held tracks), tracks.mcap and picture.png",
    )
    parser.add_argument("--picture", type=in_folder, help="plan-position picture, such as run.png")
    parser.add_argument("--animation", type=in_folder, help="plan-position animation, a .gif file")
    parser.add_argument(
        "--html", type=in_folder, help="self-contained page with a time slider, such as run.html"
    )


def run_recording(options: argparse.Namespace) -> None:
    """Start tracks on a recording, a bag or a scenario, and write them.

    Raises
    ------
    ValueError
        If an argument is not allowed, or a recording cannot be read.
    """
    if options.animation and options.animation.suffix != ".gif":
        raise ValueError(f"--animation must be a .gif file; got {options.animation}")
    if options.picture or options.animation:
        _require_matplotlib()
    with ExitStack() as stack:
        run = open_run(options, stack)
        if options.out:
            options.out.mkdir(exist_ok=True)
        recorded = run.recorded_scene() if options.html else None
        begin = time.perf_counter()
        scene = _process(run, options, recorded)
        seconds = time.perf_counter() - begin
    _report(run, scene, seconds, options)
    _draw(run, scene, options)
    if recorded is not None:
        write_page(options.html, recorded.title, run.page_of(recorded))
        print(f"page: {options.html}", file=sys.stderr)


def _require_matplotlib() -> None:
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise ValueError("pictures and animations need matplotlib, see the extra plot") from None


def _process(
    run: Run, options: argparse.Namespace, recorded: RecordedScene | None = None
) -> RunScene:
    """Process the run and write the tracks; the scene is empty if no output needs it."""
    scene = RunScene(run.title, truth=run.truth)
    with_scene = needs_scene(options)
    with ExitStack() as stack:
        writers = _writers(options.out, run, stack)
        for result in with_progress(run.results, run.scans, "scans", "scan"):
            run.processed += 1
            for path, writer in writers.items():
                with naming(path):
                    writer.write(result.in_frame())
            if recorded is not None:
                recorded.add(result, run.session.initiator)
            if with_scene:
                scene.scans.append(
                    ScanView.of(result, run.session.settings.sensor, run.mounting_yaw)
                )
    run.judge(scene)
    return scene


def _writers(folder: Path | None, run: Run, stack: ExitStack) -> dict[Path, TrackWriter]:
    """Writers of the files in a folder, or else of the standard output, by path."""
    reason = run.session.settings.make_initiator().reason
    if folder is None:
        table = sys.stdout.isatty() and TrackListing(sys.stdout, reason, north=run.north)
        return {Path("standard output"): table or TrackTable(sys.stdout, reason)}
    tracks, current = folder / "tracks.csv", folder / "current.csv"
    writers: dict[Path, TrackWriter] = {
        tracks: TrackTable(stack.enter_context(opened_whole(tracks)), reason),
        current: CurrentTable(stack.enter_context(opened_whole(current))),
    }
    try:
        path = folder / "tracks.mcap"
        writers[path] = stack.enter_context(TrackBag(path))
    except ImportError:
        print("no tracks.mcap: it needs rosbags, see the extra bags", file=sys.stderr)
    return writers


def _report(run: Run, scene: RunScene, seconds: float, options: argparse.Namespace) -> None:
    """Print notes, drops and the speed.

    Raises
    ------
    CommandFailed
        If every scan was dropped.
    """
    dropped = run.session.dropped
    for reason, sentence in run.notes.items():
        if reason not in dropped and (run.processed or not reason.startswith("lost ")):
            print(f"note: {sentence}", file=sys.stderr)
    for reason, number in sorted(dropped.items()):
        sentence = run.notes.get(reason) or reason_of(reason).meaning
        print(f"dropped: {number} {reason}: {sentence}", file=sys.stderr)
    scans = [reason for reason in dropped if reason_of(reason).lost == "scan"]
    if scans and not run.processed:
        main = max(scans, key=dropped.__getitem__)
        why = explained(main, dropped, run.notes)
        raise CommandFailed(f"every scan was dropped, {dropped[main]} as {why}")
    if options.out:
        duration = scene.scans[-1].stamp - scene.scans[0].stamp if scene.scans else 0.0
        print(
            f"{len(scene.scans)} scans, {len(scene.starts)} confirmed tracks; {duration:.1f} s "
            f"in {seconds:.2f} s, {duration / seconds:.0f} times faster than real time"
        )


def _draw(run: Run, scene: RunScene, options: argparse.Namespace) -> None:
    picture = options.picture or (options.out and options.out / "picture.png")
    if not picture and not options.animation:
        return
    try:
        from tsepm_ros.pictures.plan_animation import animate
        from tsepm_ros.pictures.plan_position import save
    except ImportError:
        print("no picture: it needs matplotlib, see the extra plot", file=sys.stderr)
        return
    if picture:
        for path in with_progress([picture], 1, "picture", "file"):
            save(scene, path)
        print(f"picture: {picture}", file=sys.stderr)
    if options.animation:
        step = animate(scene, options.animation, progress=named_progress("animation"))
        every = "" if step == 1 else f", a frame for every {step} scans"
        print(f"animation: {options.animation}{every}", file=sys.stderr)
