"""`tsepm detect`, and `tsepm run` of a folder of images."""

import numpy as np
import pytest

from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.replay.recording import read_recording

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


def test_run_takes_the_folder(folder, capsys):
    arguments = ["-p", "max_speed:=2.0", "-p", "sensor.max_range:=21.0"]
    assert main(["run", str(folder), *arguments]) == 0
    assert len(capsys.readouterr().out.splitlines()) > 1


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("geometry.yaml", "range: [1, 2]\n", "cannot be read: KeyError('azimuth')"),
        ("times.csv", "time_s\n0\n", "holds 12 images, times.csv 1 times"),
        ("times.csv", "time_s\nnoon\n", "cannot be read"),
        ("geometry.yaml", GEOMETRY + "p_fa: 3\n", "no option 'p_fa'"),
        ("geometry.yaml", GEOMETRY.replace("-1.0, 1.0", "-60, 60"), "at most a turn, in rad"),
    ],
)
def test_a_malformed_folder_is_refused_with_a_sentence(folder, capsys, name, text, sentence):
    (folder / name).write_text(text)
    assert main(["detect", str(folder), "--out", str(folder / "out.csv")]) == 2
    assert sentence in capsys.readouterr().err
