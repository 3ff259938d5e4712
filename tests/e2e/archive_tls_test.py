# SPDX-License-Identifier: Apache-2.0
"""trocar-mesh receive with TLS: only senders with a certificate of the named authority can send."""
import pytest
from archive_peer import Receiver, study
from programs import run


@pytest.fixture(scope="session")
def certificates(work):
    """A certificate authority with two certificates, and one certificate of another."""
    folder = work / "certificates"
    folder.mkdir(exist_ok=True)
    for ca, names in (("ca", ("server", "client")), ("other_ca", ("stranger",))):
        run("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", folder / f"{ca}.key", "-out", folder / f"{ca}.pem",
            "-subj", f"/CN={ca}", "-days", 2)
        for name in names:
            run("openssl", "req", "-newkey", "rsa:2048", "-nodes", "-keyout", folder / f"{name}.key", "-out", folder / f"{name}.csr", "-subj", f"/CN={name}")
            run("openssl", "x509", "-req", "-in", folder / f"{name}.csr", "-CA", folder / f"{ca}.pem", "-CAkey", folder / f"{ca}.key",
                "-CAcreateserial", "-out", folder / f"{name}.pem", "-days", 2)
    return folder


def tls(folder, name, ca="ca"):
    return ("+tls", folder / f"{name}.key", folder / f"{name}.pem", "+cf", folder / f"{ca}.pem")


def test_tls(programs, place, certificates):
    uid, files = study(place / "sent", 1, slices=2)
    options = ("--tls-key", certificates / "server.key", "--tls-cert", certificates / "server.pem", "--tls-ca", certificates / "ca.pem")
    with Receiver(programs, place / "scans", *options, "--listen", "127.0.0.1") as receiver:
        assert receiver.send(*files).returncode != 0  # unencrypted
        assert receiver.send(*files, options=tls(certificates, "stranger")).returncode != 0  # signed by another
        assert receiver.send(*files, options=("+tla", "-ic")).returncode != 0  # without a certificate
        assert receiver.studies() == []
        done = receiver.send(*files, options=tls(certificates, "client"))
        assert done.returncode == 0, done.stdout
        receiver.wait_for_study(uid, 2)
