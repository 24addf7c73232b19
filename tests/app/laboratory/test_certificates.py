"""Calibration certificates: digital ones are read, due dates warn before and flag after."""

import json
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.common import ExitCode
from app.config.bench_file import read_bench
from app.config.certificate import (
    Certificate,
    CertificateColumn,
    CertificateError,
    bench_warnings,
    due_after,
    read_certificates,
    store_certificate,
)
from app.config.dcc import read_dcc
from app.config.sensor_calibration import SensorCalibrationError, calibration_of_certificate
from protocols.base import Quality
from protocols.runfile.reader import Run

DCC = """<?xml version="1.0" encoding="utf-8"?>
<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si" schemaVersion="{version}">
<dcc:administrativeData>
 <dcc:coreData><dcc:uniqueIdentifier>D-K-4711</dcc:uniqueIdentifier>
  <dcc:beginPerformanceDate>2026-03-01</dcc:beginPerformanceDate><dcc:endPerformanceDate>2026-03-02</dcc:endPerformanceDate></dcc:coreData>
 <dcc:items><dcc:item><dcc:name><dcc:content lang="de">Laser</dcc:content><dcc:content lang="en">Laser sensor</dcc:content></dcc:name>
  <dcc:manufacturer><dcc:name><dcc:content>Keyence</dcc:content></dcc:name></dcc:manufacturer><dcc:model>LK-G30</dcc:model>
  <dcc:identifications>
   <dcc:identification><dcc:issuer>customer</dcc:issuer><dcc:value>inventory 7</dcc:value></dcc:identification>
   <dcc:identification><dcc:issuer>manufacturer</dcc:issuer><dcc:value>SIM-1</dcc:value>
    <dcc:name><dcc:content lang="en">Serial no.</dcc:content></dcc:name></dcc:identification>
  </dcc:identifications></dcc:item></dcc:items>
 <dcc:calibrationLaboratory><dcc:contact><dcc:name><dcc:content>Kalibrierfirma GmbH</dcc:content></dcc:name></dcc:contact></dcc:calibrationLaboratory>
</dcc:administrativeData>
<dcc:measurementResults><dcc:measurementResult><dcc:results><dcc:result>
 <dcc:name><dcc:content>Results</dcc:content></dcc:name>
 <dcc:data><dcc:list>
  <dcc:quantity refType="basic_referenceValue"><dcc:name><dcc:content>Position</dcc:content></dcc:name>
   <si:hybrid><si:realListXMLList><si:valueXMLList>-5 0 5</si:valueXMLList><si:unitXMLList>\\milli\\metre</si:unitXMLList></si:realListXMLList>
    <si:realListXMLList><si:valueXMLList>-5000 0 5000</si:valueXMLList><si:unitXMLList>\\micro\\metre</si:unitXMLList></si:realListXMLList></si:hybrid>
   <dcc:measurementMetaData><dcc:metaData><dcc:data><dcc:quantity><si:real><si:value>1</si:value><si:unit>\\one</si:unit></si:real></dcc:quantity></dcc:data></dcc:metaData></dcc:measurementMetaData>
  </dcc:quantity>
  <dcc:quantity><dcc:name><dcc:content>Output</dcc:content></dcc:name>
   <si:realListXMLList><si:valueXMLList>-9.99 0.01 10.02</si:valueXMLList><si:unitXMLList>\\volt</si:unitXMLList>{uncertainty}</si:realListXMLList></dcc:quantity>
 </dcc:list></dcc:data></dcc:result></dcc:results></dcc:measurementResult></dcc:measurementResults>
</dcc:digitalCalibrationCertificate>
"""
OLD = (
    "<si:expandedUncXMLList><si:uncertaintyXMLList>0.02</si:uncertaintyXMLList>"
    "<si:coverageFactorXMLList>2</si:coverageFactorXMLList></si:expandedUncXMLList>"
)
NEW = (
    "<si:measurementUncertaintyUnivariateXMLList><si:expandedMUXMLList><si:valueExpandedMUXMLList>0.02 0.04 0.02"
    "</si:valueExpandedMUXMLList><si:coverageFactorXMLList>2</si:coverageFactorXMLList></si:expandedMUXMLList>"
    "</si:measurementUncertaintyUnivariateXMLList>"
)


@pytest.fixture(autouse=True)
def own_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platformdirs.user_config_path", lambda *_, **__: tmp_path / "settings")


def dcc(folder: Path, version: str = "3.1.1", uncertainty: str = OLD) -> Path:
    path = folder / "dcc.xml"
    path.write_text(DCC.replace("{version}", version).replace("{uncertainty}", uncertainty), "utf-8")
    return path


@pytest.mark.parametrize(
    ("version", "uncertainty", "standard"),
    [("3.1.1", OLD, (0.01, 0.01, 0.01)), ("3.3.0", NEW, (0.01, 0.02, 0.01)), ("3.2.0", "", ())],
)
def test_a_digital_certificate_is_read(
    tmp_path: Path, version: str, uncertainty: str, standard: tuple[float, ...]
) -> None:
    found = read_dcc(dcc(tmp_path, version, uncertainty))
    assert (found.number, found.laboratory, found.date) == ("D-K-4711", "Kalibrierfirma GmbH", "2026-03-02")
    assert (found.item, found.serial) == ("Keyence LK-G30", "SIM-1")
    position, output = found.columns
    assert (position.name, position.unit, position.values) == ("Position", "mm", (-5.0, 0.0, 5.0))
    assert (output.name, output.unit, output.values) == ("Output", "V", (-9.99, 0.01, 10.02))
    assert output.standard_uncertainties == pytest.approx(standard)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no XML file"),
        ("<a/>", "no digital calibration certificate"),
        ('<!DOCTYPE a [<!ENTITY x "y">]><a>&x;</a>', "document type declaration"),
        (DCC.replace("{version}", "2.4.0"), "version 2.4.0; version 3 can be read"),
        (DCC.replace("{version}", "3.1.1").replace("10.02", "ten"), "'Output' of 'Results' is damaged"),
        (DCC.replace("{version}", "3.1.1").replace("10.02", "nan"), "not finite"),
        (DCC.replace("{version}", "3.1.1").replace("D-K-4711", ""), "no number"),
        (DCC.replace("{version}", "3.1.1").replace("{uncertainty}", NEW.replace("0.04 ", "")), "3 values have 2"),
        (DCC.replace("{version}", "3.1.1").replace("2026-03-02", "yesterday"), "is no day"),
    ],
)
def test_other_files_are_refused_in_a_sentence(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "other.xml"
    path.write_text(text.replace("{uncertainty}", ""), "utf-8")
    with pytest.raises(CertificateError, match=says):
        read_dcc(path)


def test_due_dates_warn_before_and_after() -> None:
    today = date(2026, 11, 22)
    for due, state, words in (
        ("2026-12-31", "valid", ""),
        ("2026-12-22", "due soon", "is due on 2026-12-22, in 30 days"),
        ("2026-11-22", "due soon", "in 0 days"),
        ("2026-11-21", "expired", "expired on 2026-11-21; every point of this run is flagged"),
        ("", "no due date", ""),
    ):
        one = Certificate("N1", "lab", "2026-01-01", "LK-G30", "S1", "sensor", due)
        assert one.state(today) == state
        assert words in one.warning(today)
    assert due_after("2026-01-31", 12) == "2027-01-31"
    with pytest.raises(CertificateError, match="before its date"):
        Certificate("N1", "lab", "2026-01-01", due="2025-01-01")
    with pytest.raises(CertificateError, match="there is no instrument 'lamp'"):
        Certificate("N1", "lab", "2026-01-01", role="lamp")


def test_the_newest_certificate_of_an_instrument_counts(tmp_path: Path) -> None:
    today = datetime.now(UTC).date()
    past, future = (today - timedelta(days=9)).isoformat(), (today + timedelta(days=9)).isoformat()
    bench: Mapping[str, object] = {"sensor": {"serial": "S1"}, "identities": {"card": "NI USB-6341 #C2"}}
    assert bench_warnings(tmp_path, bench, "sine-dwell") == ("", ())
    store_certificate(tmp_path, Certificate("1", "lab", "2020-01-01", "laser", "S1", "sensor", past))
    store_certificate(tmp_path, Certificate("2", "lab", "2020-01-01", "card", "c2", "card", future))
    store_certificate(tmp_path, Certificate("3", "lab", "2020-01-01", "set", "", "weights", past))
    store_certificate(tmp_path, Certificate("4", "lab", "2020-01-01", "other laser", "S9", "sensor", past))
    expired, soon = bench_warnings(tmp_path, bench, "sine-dwell")
    assert expired.startswith("The calibration of sensor laser #S1 (certificate 1) expired")
    assert ["certificate 2" in text for text in soon] == [True]
    assert "certificate 3" in bench_warnings(tmp_path, bench, "static-loading")[0]
    store_certificate(tmp_path, Certificate("5", "lab", "2021-01-01", "laser", "S1", "sensor", "2999-01-01"))
    assert bench_warnings(tmp_path, bench, "sine-dwell")[0] == ""
    (tmp_path / "certificates" / "6.certificate.json").write_text("{")
    assert "6.certificate.json cannot be read" in bench_warnings(tmp_path, bench, "sine-dwell")[1][-1]
    assert [each.number for each in read_certificates(tmp_path)[0]] == ["1", "3", "4", "2", "5"], "by due date"


@pytest.mark.deep
def test_certificates_are_added_listed_and_flag_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = tmp_path / "runs"
    pdf, table = tmp_path / "scan.PDF", tmp_path / "points.csv"
    pdf.write_bytes(b"%PDF-1.4")
    table.write_text("load [g],u(load) [g]\n10,0.001\n20,0.001\n")
    add = ["certificate", "add", "--folder", str(runs)]
    assert (
        main([*add, str(dcc(tmp_path)), "--role", "sensor", "--due", "2026-04-01", "--pdf", str(pdf)]) == ExitCode.DONE
    )
    typed = [
        "--number",
        "W 1",
        "--laboratory",
        "lab",
        "--date",
        "2026-01-05",
        "--months",
        "2400",
        "--table",
        str(table),
    ]
    assert main([*add, *typed, "--role", "weights"]) == ExitCode.DONE
    assert main([*add, *typed, "--role", "weights"]) == ExitCode.USAGE, "no certificate is replaced"
    assert main([*add, "--role", "card", "--number", "7"]) == ExitCode.USAGE
    assert "has no laboratory" in capsys.readouterr().err
    assert main(["certificate", "list", "--folder", str(runs), "--json"]) == ExitCode.FAILED
    listed = json.loads(capsys.readouterr().out)["certificates"]
    assert (listed["state"], listed["number"]) == (["expired", "valid"], ["D-K-4711", "W 1"])
    assert main(["certificate", "show", "W", "--folder", str(runs)]) == ExitCode.DONE
    assert "load [g]: 10, 20; standard uncertainties 0.001" in capsys.readouterr().out
    assert (runs / "certificates" / "D-K-4711.pdf").read_bytes() == b"%PDF-1.4"
    assert (runs / "certificates" / "D-K-4711.xml").exists()
    short = ["--set", "frequencies_hz=160", "--set", "record_s=0.1", "--out", str(runs), "--speed", "max"]
    assert main(["--bench", "ideal", "run", "sine-dwell", *short]) == ExitCode.DONE
    (path,) = runs.glob("*.h5")
    with Run(path) as run:
        assert int(run.points()["quality"][0]) & Quality.CALIBRATION_EXPIRED
        assert any("certificate D-K-4711) expired" in str(event.fields) for event in run.events())


def test_a_certificates_gain_takes_the_place_of_the_typed_one(tmp_path: Path) -> None:
    bench, points, runs = tmp_path / "b.toml", tmp_path / "points.csv", str(tmp_path / "runs")
    bench.write_text(
        '[generator]\nresource = "TCPIP::192.0.2.7::5025::SOCKET"\n[card]\ndevice = "Dev1"\n'
        '[sensor]\n# typed once\nserial = "LK-1"\ngain_m_per_v = "-0.1 mm/V"\n'
    )
    points.write_text("displacement [mm],u(displacement) [mm],output [V]\n-1,0.001,10.5\n0,0.001,0.5\n1,0.001,-9.5\n")
    number = ["certificate", "add", "--number", "LK-7", "--laboratory", "KC", "--date", "2026-05-04", "--folder", runs]
    assert main([*number, "--role", "sensor", "--serial", "LK-1", "--months", "12", "--table", str(points)]) == 0
    use = ["certificate", "use", "LK-7", "--folder", runs, "--bench"]
    assert main([*use, str(bench)]) == 0
    sensor = read_bench(bench.read_text(), str(bench)).sensor
    laser = sensor.laser_sensor
    assert laser.displacement_m([10.5, 0.5, -9.5]) == pytest.approx([-1e-3, 0.0, 1e-3], abs=1e-9)
    assert laser.gain_relative_uncertainty == pytest.approx(1e-6 / 2**0.5 / 1e-3, rel=0.05)
    assert (sensor.certificate, sensor.calibrated, sensor.expires) == (
        "LK-7",
        "2026-05-04",
        due_after("2026-05-04", 12),
    )
    assert "# typed once" in bench.read_text()
    assert main([*use, "sim"]) == ExitCode.USAGE
    bench.write_text(bench.read_text().replace('serial = "LK-1"', 'serial = "LK-2"'))
    before = bench.read_bytes()
    assert main([*use, str(bench)]) == ExitCode.USAGE
    assert bench.read_bytes() == before


def test_a_stated_gain_keeps_the_sign_and_zero_of_the_bench() -> None:
    gain = CertificateColumn("sensitivity", "mm/V", (0.1003,), (0.0002,))
    line = calibration_of_certificate(Certificate("C", "Lab", "2026-05-04", columns=(gain,)))
    assert (line.gain_m_per_v, line.gain_relative_uncertainty) == pytest.approx((1.003e-4, 0.0002 / 0.1003))
    assert line.is_gain_alone
    with pytest.raises(SensorCalibrationError):
        calibration_of_certificate(Certificate("C", "Lab", "2026-05-04", columns=(replace(gain, unit="mm"),)))


def test_a_polynomial_becomes_the_best_line_of_the_valid_range_with_its_bend_as_uncertainty() -> None:
    terms = {"mm": 0.02, "mm/V": 0.1, "mm/V^2": 2e-4, "mm/V^3": 5e-6}
    columns = tuple(CertificateColumn(f"a{n}", unit, (value,)) for n, (unit, value) in enumerate(terms.items()))
    certificate = Certificate("C", "Lab", "2026-05-04", columns=columns)
    line = calibration_of_certificate(certificate, (-10.0, 10.0))
    v = np.linspace(-10, 10, 20001)
    truth_m = 1e-3 * (0.02 + 0.1 * v + 2e-4 * v**2 + 5e-6 * v**3)
    assert line.gain_m_per_v == pytest.approx(1e-3 * (0.1 + 0.6 * 100 * 5e-6), rel=1e-4)  # of a cube: 3/5 of its square
    bend_m = truth_m - line.gain_m_per_v * (v - line.zero_v)
    assert max(map(abs, line.residuals_m)) == pytest.approx(np.abs(bend_m).max(), rel=0.01)
    assert line.gain_relative_uncertainty == pytest.approx(bend_m.std() / truth_m.std(), rel=0.1)
    narrow = calibration_of_certificate(certificate, (-1.0, 1.0))
    assert narrow.gain_m_per_v == pytest.approx(1e-4, rel=1e-4)
    assert narrow.gain_relative_uncertainty < 0.2 * line.gain_relative_uncertainty
    stated = replace(columns[1], standard_uncertainties=(0.001,))
    sure = replace(certificate, columns=(columns[0], stated, *columns[2:]))
    assert calibration_of_certificate(sure, (-1.0, 1.0)).gain_relative_uncertainty == pytest.approx(0.01, rel=0.01)
