"""The command `tsepm`, and those that detect and evaluate."""

import argparse
import os
import re
import sys
import threading
from contextlib import ExitStack

import numpy as np
import pytest
import yaml

from msg_adapters.sonar_images import located
from tsepm_ros.methods.registry import available_methods
from tsepm_ros.settings.node_options import ImageLayout
from tsepm_ros.settings.settings import NODES
from tsepm_ros.tools.commands import evaluate_command
from tsepm_ros.tools.commands.cli import COMMANDS, main
from tsepm_ros.tools.commands.run_command import add_source_arguments, open_run
from tsepm_ros.tools.evaluation.result_files import read_result
from tsepm_ros.tools.replay.image_folder import read_images
from tsepm_ros.tools.replay.recording import read_recording


def test_methods_are_listed_with_what_they_are(capsys):
    assert main(["methods"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == list(available_methods())


def test_parameters_are_one_file_of_all_nodes(capsys):
    assert main(["parameters", "all"]) == 0
    assert list(yaml.safe_load(capsys.readouterr().out)) == [f"/**/{node}" for node in NODES]


def test_an_interrupt_ends_a_command_with_a_word(capsys, tmp_path, monkeypatch):
    def interrupted(prompt):
        raise KeyboardInterrupt

    monkeypatch.setattr("builtins.input", interrupted)
    for stream in (sys.stdin, sys.stdout):
        monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    assert main(["init", str(tmp_path / "sonar.yaml")]) == 130
    assert capsys.readouterr().err == "interrupted\n"
    assert not list(tmp_path.iterdir())


def test_a_reader_that_closes_the_pipe_is_no_error(capsys, monkeypatch):
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w") as pipe:
        monkeypatch.setattr(sys, "stdout", pipe)
        assert main(["parameters", "all"]) == 0
    assert capsys.readouterr().err == ""


def test_a_command_runs_in_any_thread(capsys):
    codes = []
    thread = threading.Thread(target=lambda: codes.append(main(["methods"])))
    thread.start()
    thread.join()
    assert codes == [0]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("run /nowhere", "/nowhere is neither"),
        ("run /nowhere.mcap", "/nowhere.mcap is neither"),
        ("run four_target", "four_targets"),
        ("run nowhere.yaml", "nowhere.yaml"),
        ("run box -p own_ship_source:=tf", "own_ship_source tf"),
        (
            "run box -p bearing_reference:=north -p own_ship_source:=none",
            "fixed_frame must be given",
        ),
        ("evaluate nowhere", "nowhere"),
        ("evaluate -p min_hats:=4", "min_hats"),
        ("evaluate --method score -p min_hits:=4", "min_hits"),
        ("evaluate --method tsepm -p min_hits:=99", "min_hits"),
        ("evaluate --horizon 17", "horizon 17"),
        ("evaluate --scene sensor.colour:=1.0", "colour"),
        ("evaluate --scene sensor.azimuth_std:=wide", "sensor.azimuth_std"),
        ("evaluate box box", "box is given twice"),
        ("evaluate box -p min_hits=4", "min_hits=4"),
        ("run /nowhere -p sensor.range_std:=-1.0", "/nowhere is neither"),
        ("run box -p clutter_density:=2e-4", "did you mean sensor.clutter_density?"),
        ("run box -p max_range:=300.0", "did you mean sensor.max_range?"),
        ("evaluate --scene name:=", "scenario.name must be a text"),
        ("evaluate --scene name:=../up", "scenario.name must be a text"),
        ("run box -p max_speed:=" + "[" * 5000, "is not a value"),
        ("run box -p sound_speed:=3.0", "sound_speed must be 0 or at least"),
        ("health --timeout 0", "--timeout must be a positive number"),
    ],
)
def test_what_is_not_allowed_is_refused_with_a_sentence(
    capsys, tmp_path, monkeypatch, arguments, named
):
    monkeypatch.chdir(tmp_path)
    assert main(arguments.split()) == 2
    error = capsys.readouterr().err
    assert error.startswith("refused: ")
    assert named in error
    assert not list(tmp_path.iterdir())  # before anything was done


def test_a_number_that_must_be_positive_and_an_unknown_command_are_refused(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["evaluate", "--runs", "0"])
    assert ended.value.code == 2
    assert "must be at least 1" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["foo"])
    said = capsys.readouterr().err
    assert re.findall(r"'(\w+)'", said.partition("choose from")[2]) == list(COMMANDS)


@pytest.mark.parametrize("command", ["run", "watch", "design", "evaluate", "reproduce"])
@pytest.mark.parametrize("given", ["-1", "1.5", "x"])
def test_a_seed_that_is_none_is_refused_by_its_option(capsys, command, given):
    with pytest.raises(SystemExit) as ended:
        main([command, "--seed", given])
    assert ended.value.code == 2
    assert "argument --seed: " in capsys.readouterr().err


GEOMETRY = "range: [1.0, 20.9]\nazimuth: [-1.0, 1.0]\nfalse_detections_per_ping: 5\n"


@pytest.fixture
def folder(tmp_path):
    """Twelve images of noise with an echo that moves, as one array."""
    rng = np.random.default_rng(1)
    images = np.abs(rng.standard_normal((12, 64, 200)) + 1j * rng.standard_normal((12, 64, 200)))
    for k, image in enumerate(images):
        image[30:32, 100 + 2 * k : 103 + 2 * k] = 20.0
    np.savez(tmp_path / "images.npz", np.uint8(10 * images))
    (tmp_path / "geometry.yaml").write_text(GEOMETRY)
    (tmp_path / "times.csv").write_text("time_s\n" + "".join(f"{k}\n" for k in range(12)))
    return tmp_path


def test_detections_and_a_picture_are_written(folder, capsys):
    pytest.importorskip("matplotlib")
    out, picture = folder / "out.csv", folder / "picture.png"
    assert main(["detect", str(folder), "--out", str(out), "--picture", str(picture)]) == 0
    recording = read_recording(out)
    assert len(recording.scans) == 12
    strongest = [
        scan.fields["range"][np.argmax(scan.fields["intensity"])] for scan in recording.scans
    ]
    assert strongest == pytest.approx(11.1 + 0.2 * np.arange(12), abs=0.15)
    assert picture.stat().st_size > 10_000
    assert "images 12, empty 0" in capsys.readouterr().err


def test_pictures_of_rows_of_ranges_are_read_too(folder, tmp_path):
    imsave = pytest.importorskip("matplotlib.image").imsave
    with np.load(folder / "images.npz") as stored:
        images = stored["arr_0"]
    (folder / "images.npz").unlink()
    rows = ["time_s,file"]
    for k, image in enumerate(images):
        np.save(folder / f"{k}.npy", image.T)
        rows.append(f"{k},{k}.npy")
    (folder / "times.csv").write_text("\n".join(rows))
    (folder / "geometry.yaml").write_text(GEOMETRY + "rows: ranges\n")
    assert main(["detect", str(folder), "--out", str(folder / "out.csv")]) == 0
    imsave(folder / "0.png", images[0])
    (folder / "times.csv").write_text("time_s,file\n0,0.png\n")
    assert main(["detect", str(folder), "--out", str(folder / "out.csv")]) == 2


def test_run_takes_the_folder_with_the_coverage_of_its_images_unless_another_is_given(
    folder, capsys
):
    assert main(["run", str(folder), "-p", "max_speed:=2.0"]) == 0
    assert len(capsys.readouterr().out.splitlines()) > 1
    parser = argparse.ArgumentParser()
    add_source_arguments(parser)
    options = parser.parse_args([str(folder), "-p", "sensor.max_range:=15.0"])
    with ExitStack() as stack:
        sensor = open_run(options, stack).session.settings.sensor
    assert (sensor.min_range, sensor.max_range) == pytest.approx((0.95, 15.0))
    assert (sensor.azimuth_min, sensor.azimuth_max) == pytest.approx((-1.016, 1.016), abs=1e-3)


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("geometry.yaml", "range: [1, 2]\n", "azimuth must be a list, of first and last"),
        ("times.csv", "time_s\n0\n", "holds 12 images, times.csv 1 times"),
        ("times.csv", "time_s\nnoon\n", "cannot be read"),
        ("geometry.yaml", GEOMETRY + "p_fa: 3\n", "p_fa is not a parameter"),
        (
            "geometry.yaml",
            GEOMETRY.replace("-1.0, 1.0", "-60, 60"),
            "(in rad; -60 degrees are -1.047 rad)",
        ),
        ("geometry.yaml", GEOMETRY + "rows: range\n", "rows must be one of auto, ranges, beams"),
        ("geometry.yaml", GEOMETRY + "false_detections_per_ping: many\n", "must be a number"),
        ("geometry.yaml", GEOMETRY + "near_range: 0.5\n", "near_range and far_range must be given"),
        (
            "geometry.yaml",
            GEOMETRY.replace("1.0, 20.9", "1, 5" + "0" * 400),
            "range must be a number",
        ),
        ("geometry.yaml", GEOMETRY.replace("[-1.0, 1.0]", "null"), "azimuth must be a list"),
        ("geometry.yaml", "- 1\n", "expected names and values"),
        ("geometry.yaml", "a: &a [1]\nrange: *a\n", "aliases"),
        ("times.csv", "time_s\n" + "0\n" * 12, "ascend"),
        ("times.csv", "time_s\n" + "".join(f"{k}\n" for k in range(11)) + "nan\n", "ascend"),
        ("times.csv", "time\n" + "0\n" * 12, "time_s of times.csv must have a number"),
        ("times.csv", "time_s\n" + "".join(f"{k}e12\n" for k in range(12)), "in milliseconds?"),
        ("images.npz", "PK broken", "cannot be read as images"),
    ],
)
def test_a_malformed_folder_is_refused_with_a_sentence(folder, capsys, name, text, sentence):
    (folder / name).write_text(text)
    assert main(["detect", str(folder), "--out", str(folder / "out.csv")]) == 2
    assert sentence in capsys.readouterr().err


def huge_array(shape: str) -> bytes:
    """A file .npy whose header promises a shape."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode() + b"x" * 100


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("0.npy", huge_array("(1000000, 10000000)")),
        ("0.npy", huge_array("()")),
        ("0.pgm", b"P5\n99999999 99999999\n255\n"),
        ("0.pgm", b"P5\n30 30\n255\n"),
        ("0.png", b"\x89PNG\r\n\x1a\nbroken"),
        ("0.ppm", b"P6\n2 1\n255\n\x01\x01\x01\x01\x02\x01"),
    ],
    ids=["huge array", "no array", "huge picture", "cut picture", "broken picture", "colours"],
)
def test_an_image_that_cannot_be_read_is_refused_whatever_its_header_says(
    tmp_path, capsys, name, content
):
    pytest.importorskip("matplotlib")
    (tmp_path / "geometry.yaml").write_text(GEOMETRY)
    (tmp_path / "times.csv").write_text(f"time_s,file\n0,{name}\n")
    (tmp_path / name).write_bytes(content)
    assert main(["detect", str(tmp_path), "--out", str(tmp_path / "o.csv")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("refused: ") and ("colours" in said or name != "0.ppm")


def test_pictures_of_16_bits_and_of_three_equal_channels_are_as_their_arrays(tmp_path):
    pytest.importorskip("matplotlib")
    rng = np.random.default_rng(2)
    images = rng.rayleigh(4000.0, (3, 30, 90)).astype(np.uint16)
    found = []
    for form in ("npy", "pgm", "ppm"):
        folder = tmp_path / form
        folder.mkdir()
        (folder / "geometry.yaml").write_text(GEOMETRY)
        names = [f"{k}.{form}" for k in range(3)]
        rows = [f"{k},{name}" for k, name in enumerate(names)]
        (folder / "times.csv").write_text("\n".join(["time_s,file", *rows]))
        for name, image in zip(names, images if form != "ppm" else images >> 8, strict=True):
            if form == "npy":
                np.save(folder / name, image)
            elif form == "pgm":
                (folder / name).write_bytes(b"P5\n90 30\n65535\n" + image.astype(">u2").tobytes())
            else:
                three = np.repeat(image.astype(np.uint8), 3)
                (folder / name).write_bytes(b"P6\n90 30\n255\n" + three.tobytes())
        _, _, read = read_images(folder, [])
        found.append([image.intensity for image in read])
    np.testing.assert_array_equal(found[0], images)
    np.testing.assert_array_equal(found[1], images)
    np.testing.assert_array_equal(found[2], images >> 8)


@pytest.mark.parametrize("rows", ["beams", "ranges", "fan"])
def test_a_folder_is_read_as_the_node_reads_the_same_picture(tmp_path, rows):
    image = np.random.default_rng(2).rayleigh(4000.0, (40, 60)).astype(np.uint16)
    np.save(tmp_path / "images.npy", image[None])
    (tmp_path / "times.csv").write_text("time_s\n0\n")
    ends = "range: [12.0, 0.5]" if rows != "fan" else "range: [0.5, 12.0]"
    (tmp_path / "geometry.yaml").write_text(f"{ends}\nazimuth: [0.6, -0.6]\nrows: {rows}\n")
    notes: list[str] = []
    _, _, images = read_images(tmp_path, notes)
    [read] = images
    layout = ImageLayout(rows=rows)  # far first, port first
    range_, azimuth, intensity = located(image, layout, (0.5, 12.0), (-0.6, 0.6))
    np.testing.assert_array_equal(read.intensity, intensity)
    np.testing.assert_allclose(read.range, range_)
    half = 0.6 / len(azimuth) if rows != "fan" else 0.0  # of a fan the edges are given
    np.testing.assert_allclose(read.azimuth, azimuth * 0.6 / (0.6 - half))
    assert ("top left" in notes[0]) == (rows != "fan")


def test_an_output_is_no_input_whatever_it_is_called(folder, capsys):
    (folder / "link.csv").symlink_to(folder / "times.csv")
    for out in ("times.csv", "geometry.yaml", "images.npz", "link.csv"):
        before = (folder / out).read_bytes()
        assert main(["detect", str(folder), "--out", str(folder / out)]) == 2
        assert "is not overwritten" in capsys.readouterr().err
        assert (folder / out).read_bytes() == before
    assert main(["detect", str(folder), "--out", str(folder / "detections.csv")]) == 0
    recording = folder / "detections.csv"
    assert main(["run", str(folder), "--html", str(recording)]) == 2
    target = folder / "tracks.csv"
    target.write_bytes(recording.read_bytes())
    before = target.read_bytes()
    assert main(["run", str(target), "--out", str(folder)]) == 2
    assert target.read_bytes() == before


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["four_targets", "--detections", "/sonar"], "--detections has no meaning for a scenario"),
        (["recording", "--odometry", "/odom"], "--odometry has no meaning for a recording"),
        (["recording", "--seed", "0"], "--seed has no meaning for a recording"),
        (["recording", "--origin", "1,2"], "--origin is for --as and --html"),
    ],
)
def test_an_option_without_a_meaning_for_the_source_is_refused(
    tmp_path, monkeypatch, capsys, given, words
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recording").mkdir()
    (tmp_path / "recording" / "detections.csv").write_text("time_s,range_m,azimuth_rad\n0,1,0\n")
    assert main(["run", *given]) == 2
    assert words in capsys.readouterr().err


def evaluated(tmp_path, *arguments):
    small = ["--method", "score", "--runs", "3", "--scans", "8", "--workers", "1"]
    assert main(["evaluate", *small, "--out", str(tmp_path), *arguments]) == 0


@pytest.mark.long
def test_an_evaluation_writes_tables_that_say_how_they_were_made(capsys, tmp_path):
    path = tmp_path / "deep" / "figures.json"
    changed = ("--seed", "3", "-p", "false_tracks_per_hour:=300.0")
    evaluated(tmp_path, "--horizon", "6", *changed, "--result", str(path))
    out = capsys.readouterr().out
    assert out.startswith("3 runs, seed 3\n")
    assert [line.split()[:2] for line in out.splitlines()[3:5]] == [["box", "6"], ["box", "8"]]
    text = (tmp_path / "evaluation.md").read_text()
    for part in ("tsepm evaluate --method score", "3 runs", "seed 3", "## box, 8 scans", "95 %"):
        assert part in text
    assert "false_tracks_per_hour:=300.0" in text
    result = read_result(path)
    assert (result.seed, result.runs) == (3, 3)
    assert result.parameters == {"false_tracks_per_hour": 300.0}
    assert result.command.startswith("tsepm evaluate --method score --runs 3 --scans 8 --horizon 6")
    assert not any(name in result.command for name in ("result", "out", "workers"))
    assert [row[:2] for row in result.rows] == [["box", "6"], ["box", "8"]]
    assert {len(row) for row in result.rows} == {len(result.header)}
    assert [row["scans"] for row in result.measures] == [6, 8]
    assert all(row["options"] == result.parameters for row in result.measures)
    path.write_text('{"seed": 1}')
    with pytest.raises(ValueError, match="not a result file"):
        read_result(path)


@pytest.mark.long
def test_an_evaluation_draws_the_operating_curves_of_each_scene(tmp_path):
    pytest.importorskip("matplotlib")
    evaluated(tmp_path, "-p", "false_tracks_per_hour:=300.0")
    assert [path.name for path in tmp_path.glob("*.png")] == ["box_operating_curve.png"]


def test_without_matplotlib_there_are_tables_and_a_sentence(capsys, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "tsepm_ros.tools.pictures.operating_curve_picture", None)
    evaluated(tmp_path, "-p", "false_tracks_per_hour:=300.0")
    assert "no pictures: they need matplotlib" in capsys.readouterr().out
    assert (tmp_path / "evaluation.csv").exists()
    assert not list(tmp_path.glob("*.png"))


def test_what_will_be_done_is_said_before_the_first_run(capsys, monkeypatch, scenario, tmp_path):
    def ends(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluate_command, "evaluate", ends)
    arguments = ["evaluate", scenario, "--method", "score", "--runs", "50"]
    assert main([*arguments, "--out", str(tmp_path), "--workers", "3"]) == 130
    done, *_ = capsys.readouterr().err.splitlines()
    assert "runs: 50 of each of " in done and "operating points of 1 methods on small" in done
