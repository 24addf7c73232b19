"""Acceptance of a calibration: a result that is not adequate, or was not tested, needs a written reason."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.identification import AcceptanceError, accept_identification, calibrations, doubt_about
from app.identification.active_model import ActiveModel, load_active_model, reference_model
from app.identification.result_text import ADEQUACY_TEXT
from app.identification.specimen_identification import IdentificationResult, _joint_result, identify
from model import EstimatedQuantity, Membrane, Tactor
from model.identification import Calibration, ExtensionStep
from model.identification.adequacy import Adequacy
from tests.helpers.importing import brought

# A second side that is 20 % stiffer: no compliance explains both, in the beam model alone.
SIDES = "load [N],deflection [um],u_deflection [um],side,repeat\n" + "".join(
    f"{0.5 * i},{70 * i * (1 + 0.1 * side) + 0.1 * (-1) ** i:.2f},0.5,{side},1\n"
    for side in (1, -1)
    for i in range(1, 7)
)
REASON = "only compliance at small loads is needed for the mount"


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wrong")
    (folder / "t.csv").write_text(SIDES)
    return brought(folder / "t.csv", "--specimen", "T1")


@pytest.fixture(scope="module")
def found(wrong: Path) -> IdentificationResult:
    return identify([wrong], plain=True)


@pytest.mark.deep
def test_a_result_that_is_not_adequate_is_accepted_only_with_a_reason(
    wrong: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / wrong.name
    run.write_bytes(wrong.read_bytes())
    for reason in ((), ("--reason", " ok ")):
        assert main(["identify", str(run), "--plain", "--accept", *reason]) == 2
        said = capsys.readouterr().err
        assert "nothing is accepted: the result is NOT ADEQUATE: the model is wrong for these runs" in said
        assert "--reason TEXT" in said
        assert calibrations.read_calibrations(tmp_path, "T1").versions == ()
    assert main(["identify", str(run), "--plain", "--accept", "--reason", REASON]) == 0
    accepted = calibrations.read_calibrations(tmp_path, "T1").get()
    assert accepted.reason == REASON
    assert accepted.doubt.startswith(f"{ADEQUACY_TEXT[False]}: ")
    assert accepted.decision in " ".join(capsys.readouterr().out.split())
    assert main(["calibration", "show", "T1", "--folder", str(tmp_path)]) == 0
    assert accepted.decision in " ".join(capsys.readouterr().out.split())
    assert load_active_model(tmp_path, "T1").description == "calibration 1 of T1 (accepted although NOT ADEQUATE)"


def test_an_unchecked_result_needs_a_reason_and_an_adequate_one_does_not(
    found: IdentificationResult, tmp_path: Path
) -> None:
    for adequacy in (None, Adequacy(None, "no residual is left over", (), 0)):
        with pytest.raises(AcceptanceError, match="unchecked: "):
            accept_identification(replace(found, adequacy=adequacy), tmp_path, ())
    fine = replace(found, adequacy=Adequacy(True, "the misfit is noise", (), 9))
    assert doubt_about(fine) == ""
    accepted, path = accept_identification(fine, tmp_path, (), reason="a reason that is not needed")
    assert (accepted.version, accepted.decision, accepted.reason) == (1, "", "")
    record = json.loads(path.read_text("utf-8"))["versions"][0]
    assert Calibration.from_record(record) == accepted
    assert not {"doubt", "reason"} & set(record)  # as those of earlier versions of the program
    assert Calibration.from_record(record).decision == ""
    first = load_active_model(tmp_path, "T1")
    assert load_active_model(tmp_path, "T1", first) is first
    first_version = calibrations.read_calibrations(tmp_path, "T1").get()
    assert accept_identification(fine, tmp_path, ())[0].version == 2
    assert load_active_model(tmp_path, "T1", first).description != first.description
    second = calibrations.read_calibrations(tmp_path, "T1").get(2)
    assert reference_model(tmp_path, "T1") is not None
    calibrations.write_calibrations(
        tmp_path, "T1", calibrations.Calibrations((first_version, second), 0)
    )  # none is active
    assert reference_model(tmp_path, "T1") is None
    calibrations.write_calibrations(tmp_path, "T1", calibrations.Calibrations((second,), 2))  # the first was taken out
    assert accept_identification(fine, tmp_path, ())[0].version == 3


def test_python_accepts_with_a_reason(wrong: Path, tmp_path: Path) -> None:
    import tactor_bench as tb

    result = tb.identify(wrong, plain=True)
    with pytest.raises(tb.CalibrationError, match=ADEQUACY_TEXT[False]):
        result.accept(by="K. Tanaka", folder=tmp_path)
    assert calibrations.read_calibrations(tmp_path, "T1").versions == ()
    accepted = result.accept(by="K. Tanaka", reason=REASON, folder=tmp_path)
    assert accepted.accepted_by == "K. Tanaka"
    assert tb.calibration("T1", tmp_path).decision.endswith(f"Accepted all the same: {REASON}")


def test_a_fit_with_an_added_cause_is_judged_as_the_last_one(
    found: IdentificationResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert found.joint_fit is not None
    assert found.adequacy is not None
    assert found.adequacy.diagnosis is not None
    verdicts = [Adequacy(adequate, "", (), 9) for adequate in (False, True)]
    steps = [ExtensionStep(found.adequacy.diagnosis.likeliest[0], found.joint_fit, each) for each in verdicts]
    monkeypatch.setattr("app.identification.specimen_identification.extend_stepwise", lambda *_: steps)
    result = _joint_result("T1", found.joint_fit, None, True, None)
    assert (result.adequacy, result.steps) == (verdicts[-1], tuple(steps))


def test_the_covariance_of_a_model_is_that_of_its_parameters_wherever_they_stand() -> None:
    names, values = ("E_m", "k2", "gain", "c0"), (Membrane().E_m, Tactor().k2, 1.0, Tactor().c0)
    estimates = [EstimatedQuantity(name, value, 0.1, "", "") for name, value in zip(names, values, strict=True)]
    covariance = np.diag([1.0, 4.0, 9.0, 16.0]) + 0.5
    model = ActiveModel.from_estimates(Tactor(), Membrane(), estimates, covariance)
    for kept in (model.estimates, model.membrane_estimates):
        assert kept is not None
        at = [names.index(name) for name in kept.names]
        assert np.array_equal(kept.covariance, covariance[np.ix_(at, at)])
    assert (model.estimates.names, model.membrane_estimates.names) == (("k2", "c0"), ("E_m", "k2", "c0"))  # type: ignore[union-attr]
