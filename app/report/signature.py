"""Signature of a report's files by a person's SSH key, made and verified by OpenSSH's `ssh-keygen -Y`."""

import shlex
import subprocess
from collections.abc import Sequence
from pathlib import Path

from app.common import UsageError, truncate_text
from drivers import Deadline
from protocols.base import write_atomic

NAMESPACE = "tactor-bench-report"
"""Purpose of the signature: a signature for another purpose does not verify."""
SUFFIX = ".sig"


def sign_files(files: Sequence[Path], key: Path) -> list[Path]:
    """Sign files with an SSH key and return the signatures, each beside its file; a passphrase is read from the terminal.

    Args:
        files: to sign.
        key: private key, or the public one of a key that an SSH agent or a security token holds.

    Raises:
        UsageError: OpenSSH is not installed, or the key cannot be used.
        OSError: a signature cannot be written.
    """
    if not key.is_file():
        raise UsageError(f"--sign {key}: there is no such file; give an SSH key, for example ~/.ssh/id_ed25519")
    signatures = []
    for file in files:
        try:
            ran = subprocess.run(  # noqa: S603 - no shell
                ["ssh-keygen", "-Y", "sign", "-q", "-f", str(key), "-n", NAMESPACE],  # noqa: S607 - the user's OpenSSH
                input=file.read_bytes(),
                capture_output=True,
                timeout=Deadline.SIGNATURE.seconds,
                check=False,
            )
        except FileNotFoundError:
            raise UsageError(
                "--sign needs ssh-keygen, which is not installed; install OpenSSH, or leave --sign out"
            ) from None
        except subprocess.TimeoutExpired:
            raise UsageError(
                f"--sign {key}: the report is written, but not signed: ssh-keygen took more than {Deadline.SIGNATURE.seconds:g} s; "
                "give a key that needs no passphrase, or add it to the SSH agent first"
            ) from None
        text = ran.stdout.decode("ascii", "replace")
        if ran.returncode or not text.startswith("-----BEGIN SSH SIGNATURE-----"):
            reason = truncate_text(ran.stderr.decode("utf-8", "replace").strip() or f"exit code {ran.returncode}")
            raise UsageError(f"--sign {key}: the report is written, but not signed: {reason}; give a private SSH key")
        signatures.append(file.with_name(file.name + SUFFIX))
        write_atomic(signatures[-1], text)
    return signatures


def verification_command(file: Path, name: str) -> str:
    """Return the command that verifies the signature of a file; `allowed_signers` lists names with their public keys."""
    return f"ssh-keygen -Y verify -f allowed_signers -I {shlex.quote(name)} -n {NAMESPACE} -s {file.name}{SUFFIX} < {file.name}"
