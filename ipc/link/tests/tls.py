"""TLS with certificates on both sides, by the configuration that docs/link.md shows: who has a certificate of the authority gets through,
who has none, or one of another authority, does not, and neither does who speaks plain TCP. Needs the package eclipse-zenoh, and openssl."""

import json
import pathlib
import re
import socket
import subprocess
import tempfile
import time

import zenoh

HERE = pathlib.Path(__file__).resolve().parent
DOCUMENTED = re.search(r"```json5\n(.*?)```", (HERE.parents[2] / "docs" / "link.md").read_text(), re.S).group(1)


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def configuration(folder, listen=(), connect=()):
    """The documented one, with the certificates of a folder."""
    text = re.sub(r'"(\w+\.(?:pem|key))"', lambda name: json.dumps(str(folder / name.group(1))), DOCUMENTED)
    path = folder / "link.json5"
    path.write_text(text)
    config = zenoh.Config.from_file(str(path))
    for key, value in [
        ("mode", "peer"),
        ("scouting/multicast/enabled", False),
        ("listen/endpoints", list(listen)),
        ("connect/endpoints", list(connect)),
        ("connect/timeout_ms", 1500),
        ("connect/exit_on_failure", True),
    ]:
        config.insert_json5(key, json.dumps(value))
    return config


def arrives(near, taken, make):
    """Whether what another end puts arrives at the near one."""
    before = len(taken)
    try:
        with zenoh.open(make()) as far:
            # The subscription has reached it.
            for _ in range(50):
                far.put("beo/tls/percept", bytes(1280))
                time.sleep(0.02)
    except zenoh.ZError:
        pass
    return len(taken) > before


def main():
    with tempfile.TemporaryDirectory() as place:
        ours, others = pathlib.Path(place) / "ours", pathlib.Path(place) / "others"
        for folder in (ours, others):
            subprocess.run([HERE / "certificates", folder, "IP:127.0.0.1", "DNS:localhost"], check=True)
        port, taken = free_port(), []
        secure, plain = f"tls/127.0.0.1:{port}", f"tcp/127.0.0.1:{port}"
        with zenoh.open(configuration(ours, listen=[secure])) as near:
            subscriber = near.declare_subscriber("beo/tls/percept", lambda sample: taken.append(len(sample.payload)))

            def without_certificate():
                config = configuration(ours, connect=[secure])
                config.insert_json5("transport/link/tls", json.dumps({"root_ca_certificate": str(ours / "ca.pem"), "enable_mtls": False}))
                return config

            def another_authority():
                config = configuration(others, connect=[secure])
                # It trusts the near end, which does not trust it.
                config.insert_json5("transport/link/tls/root_ca_certificate", json.dumps(str(ours / "ca.pem")))
                return config

            cases = [
                ("a certificate of the authority", lambda: configuration(ours, connect=[secure]), True),
                ("no certificate", without_certificate, False),
                ("a certificate of another authority", another_authority, False),
                ("plain TCP", lambda: configuration(ours, connect=[plain]), False),
            ]
            failed = 0
            for name, make, expected in cases:
                found = arrives(near, taken, make)
                failed += found != expected
                print(f"{name}: {'gets through' if found else 'is kept out'}{'' if found == expected else ': WRONG'}", flush=True)
            subscriber.undeclare()
    print(f"{len(cases) - failed} passed, {failed} failed")
    raise SystemExit(failed > 0)


if __name__ == "__main__":
    main()
