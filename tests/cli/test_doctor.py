"""``geoskill-doctor``: what is here, and what to do about what is not."""

import sys

import pytest

from geoskill.cli import doctor
from geoskill.cli.doctor import Finding


def test_all_is_there(opengl: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["geoskill-doctor"])
    with pytest.raises(SystemExit) as ended:
        doctor.main()
    assert ended.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].startswith("All is there")
    for what in ("python", "package", "processor", "decoders", "encoders", "rendering", "cache", "temporary"):
        assert any(line.startswith(("ok ", "-- ")) and line.split()[1] == what for line in lines), what


def test_what_is_missing_has_advice(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["geoskill-doctor"])
    monkeypatch.setattr(doctor, "NEEDED", ("no-such-package",))
    monkeypatch.setattr(doctor, "ENCODERS", ("no_such_encoder",))
    monkeypatch.setattr(doctor, "EXTRAS", {"other": "no_such_module"})
    monkeypatch.setattr(
        doctor, "_rendering", lambda: iter([Finding("rendering", "fails", "install EGL", needed=False)])
    )
    monkeypatch.setattr(doctor, "_folders", lambda: 1 / 0)
    with pytest.raises(SystemExit) as ended:
        doctor.main()
    assert ended.value.code == 1
    output = capsys.readouterr().out
    assert "MISS package      no-such-package is not installed\n                  -> pip install" in output
    assert "without no_such_encoder; pip install" in output
    assert "--   rendering    fails\n                  -> install EGL" in output
    assert "pip install 'geoskill[other]'" in output
    assert "division by zero" in output
    missing = output.splitlines()[-1]
    assert missing.startswith("missing: package, encoders, ")
    assert "rendering" not in missing
