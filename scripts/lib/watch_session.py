# SPDX-License-Identifier: Apache-2.0
"""watch_session.py CONSOLE FOLDER SCENE: starts the console on the folder and a session of the scene, prints the console's links, and
waits until the console ends."""
import json
import re
import signal
import subprocess
import sys
import urllib.request


def main():
    program, folder, scene = sys.argv[1:]
    console = subprocess.Popen([program, folder, "--port", "0"], stdout=subprocess.PIPE, text=True)
    # Ctrl-C reaches this script, too: it waits for the console, which ends its session first.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: console.terminate())
    links = [console.stdout.readline(), console.stdout.readline()]
    found = re.match(r"operator: (http://.+/)#([0-9a-f]+)$", links[0])
    if not found:
        return console.wait() or 1
    request = urllib.request.Request(f"{found[1]}api/start", json.dumps({"scene": scene}).encode(), {"Authorization": f"Bearer {found[2]}"})
    try:
        with urllib.request.urlopen(request, timeout=20):
            pass
    except OSError as error:
        print(f"demo: the session could not be started: {error}", file=sys.stderr)
    print("".join(links) + "Open the first link in a browser. Ctrl-C ends the console and its session.", flush=True)
    return console.wait()


if __name__ == "__main__":
    sys.exit(main())
