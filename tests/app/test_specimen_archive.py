"""A specimen as one `.eln` file, read by another library, and its way back."""

import json
import shutil
import zipfile
from pathlib import Path

import h5py
import pytest

from app.archive.notes import write_notes
from app.archive.specimen_archive import ArchiveError, restore_archive
from app.cli.main import main
from app.config import Certificate, store_certificate
from tests.helpers.run_files import finished_run


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    first = finished_run(folder, "T 7/ß", (100.0, 155.0, 160.0))
    write_notes(first, tags=("good", "new glue"), note="a note: µm")
    (folder / "2025").mkdir()
    shutil.copy(first, folder / "2025" / first.name.replace("_sine", "_again_sine"))
    finished_run(folder, "T8")
    return folder


@pytest.fixture
def archive(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    out = tmp_path / "T7.eln"
    assert main(["archive", "T 7/ß", "--folder", str(runs), "--out", str(out), "--no-report"]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    return out


def test_a_crate_reader_finds_every_run_with_hash_and_mark(archive: Path, tmp_path: Path) -> None:
    """The `.eln` format: one folder with `ro-crate-metadata.json`; rocrate reads what is in it."""
    from rocrate.rocrate import ROCrate

    with zipfile.ZipFile(archive) as file:
        assert file.testzip() is None
        assert {name.partition("/")[0] for name in file.namelist()} == {"T7"}
        file.extractall(tmp_path / "out")
    crate = ROCrate(str(tmp_path / "out" / "T7"))
    assert crate.root_dataset["name"] == "SIMULATED: specimen T 7/ß"
    assert crate.root_dataset["license"]["name"] == "no licence given"
    kinds = [entity.type for entity in crate.data_entities]
    assert (kinds.count("Dataset"), kinds.count("File")) == (2, 3)
    for entity in crate.data_entities:
        if entity.type == "File":
            import hashlib

            data = (tmp_path / "out" / "T7" / entity.id).read_bytes()
            assert hashlib.sha256(data).hexdigest() == entity["sha256"]
            assert str(len(data)) == entity["contentSize"]
        else:
            assert entity["name"].startswith("SIMULATED sine-dwell of T 7/ß")
            (value,) = (
                [entity["variableMeasured"]]
                if not isinstance(entity["variableMeasured"], list)
                else entity["variableMeasured"]
            )
            assert (value["name"], value["value"], value["unitText"]) == ("natural_frequency", 158.35, "Hz")
    assert any("new glue" in str(entity.get("keywords")) for entity in crate.data_entities)


def test_people_instruments_certificates_and_trail_are_in_it_and_come_back(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from rocrate.rocrate import ROCrate

    folder, out, back = tmp_path / "runs", tmp_path / "T8.eln", tmp_path / "back"
    shutil.copytree(runs, folder)
    run = next(folder.glob("*T8*.h5"))
    role, serial = "generator", "S-1"
    with h5py.File(run, "r+") as file:
        known = json.loads(file["entry/configuration"].asstr()[()])
        del file["entry/configuration"]
        file["entry/configuration"] = json.dumps(known | {"identities": {role: f"Maker G1 #{serial}"}})
    store_certificate(folder, Certificate("C/17", "Lab", "2026-01-02", serial=serial, role="other", due="2027-01-02"))
    (folder / "T8.specimen.toml").write_text(
        'specimen = "T8"\nserial = "MFC-042"\nphotograph = "t8.png"\n[plate.L]\nvalue = "22.1 mm"\nuncertainty = "0.05 mm"\n'
    )
    (folder / "t8.png").write_bytes(b"a picture")
    assert main(["audit", "start", str(folder)]) == 0
    assert main(["checked", str(run), "--by", "Ben Keller"]) == 0
    assert main(["archive", "T8", "--folder", str(folder), "--out", str(out), "--no-report"]) == 0
    with zipfile.ZipFile(out) as file:
        file.extractall(tmp_path / "crate")
    crate = ROCrate(str(tmp_path / "crate" / "T8"))
    people = {each["name"]: each for each in crate.get_by_type("Person")}
    assert people["Ben Keller"]["familyName"] == "Keller"
    products = {each["name"]: each for each in crate.get_by_type("IndividualProduct")}
    assert products["T8"]["serialNumber"] == "MFC-042"
    (certified,) = [each for each in products.values() if each.get("subjectOf")]
    assert (certified["description"], certified["serialNumber"]) == (role, serial)
    (action,) = crate.get_by_type("CreateAction")
    assert certified in action["instrument"]
    assert main(["restore", str(out), "--folder", str(back)]) == 0
    for name in ("T8.specimen.toml", "t8.png", "certificates/C%2F17.certificate.json", run.name):
        assert (back / name).read_bytes() == (folder / name).read_bytes(), name
    assert (back / "T8.audit.jsonl").read_bytes() == (folder / "audit.jsonl").read_bytes()
    capsys.readouterr()


def test_it_comes_back_to_the_byte_and_only_once(
    runs: Path, archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    back = tmp_path / "back"
    for words in ("3 files restored", "3 files were in"):
        assert main(["restore", str(archive), "--folder", str(back)]) == 0
        captured = capsys.readouterr()
        assert words in captured.out + captured.err
    for file in back.iterdir():
        (original,) = runs.rglob(file.name)
        assert file.read_bytes() == original.read_bytes()
    notes = next(back.glob("*.notes.json"))
    notes.write_text("{}")
    assert main(["restore", str(archive), "--folder", str(back)]) == 2
    assert "has another file" in capsys.readouterr().err
    assert notes.read_text() == "{}"


def test_a_changed_byte_is_found(archive: Path, tmp_path: Path) -> None:
    """Whatever the zip file says of itself: the copy is made anew, with its own right checksums."""
    changed = tmp_path / "changed.eln"
    with zipfile.ZipFile(archive) as file, zipfile.ZipFile(changed, "w") as copy:
        for info in file.infolist():
            data = bytearray(file.read(info))
            if info.filename.endswith(".h5"):
                data[len(data) // 2] ^= 1
            copy.writestr(info.filename, bytes(data))
    with pytest.raises(ArchiveError, match="SHA-256 is another"):
        restore_archive(changed, tmp_path / "back")
    assert not list((tmp_path / "back").glob("*.h5"))


@pytest.mark.parametrize(
    "name", ["../../evil.h5", "/tmp/evil.h5", "T7/..", "a\\..\\evil.h5", "c:evil.h5", "evil\x1b[2J.h5"]
)
def test_no_file_leaves_the_folder(name: str, tmp_path: Path) -> None:
    record = {"@graph": [{"@id": f"./{name}", "@type": "File", "sha256": "0"}]}
    evil = tmp_path / "evil.eln"
    with zipfile.ZipFile(evil, "w") as file:
        file.writestr("T7/ro-crate-metadata.json", json.dumps(record))
        file.writestr(f"T7/{name}", b"")
    with pytest.raises(ArchiveError):
        restore_archive(evil, tmp_path / "deep" / "back")
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["back", "deep", "evil.eln"]


def test_what_is_no_archive_is_a_sentence(archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = archive.read_bytes()
    for number, content in enumerate((b"", b"no zip", data[: len(data) // 2], data[:200] + bytes(200) + data[400:])):
        bad = tmp_path / f"bad{number}.eln"
        bad.write_bytes(content)
        assert main(["restore", str(bad), "--folder", str(tmp_path / f"back{number}")]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert main(["restore", str(tmp_path / "missing.eln")]) == 2
    assert main(["archive", "T9", "--folder", str(tmp_path)]) == 2
    assert "there are no runs of T9" in capsys.readouterr().err


@pytest.mark.deep
def test_an_archive_has_the_report(runs: Path, tmp_path: Path) -> None:
    out = tmp_path / "T8.eln"
    assert main(["archive", "T8", "--folder", str(runs), "--out", str(out), "--licence", "https://example.org/by"]) == 0
    with zipfile.ZipFile(out) as file:
        assert {"T8/specimen/T8_report.pdf", "T8/specimen/T8_report.html"} <= set(file.namelist())
        graph = json.loads(file.read("T8/ro-crate-metadata.json"))["@graph"]
    assert {"@id": "https://example.org/by"} in [each.get("license") for each in graph]
