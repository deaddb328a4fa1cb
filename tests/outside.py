"""A driver that is no part of the package: python -I -S outside.py [fault]. Needs nothing."""

import json
import sys
import time


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main(fault: str) -> None:
    """Answer each line."""
    steps = 0
    for line in sys.stdin:
        seen = json.loads(line)
        steps += 1
        if steps == 3:
            if fault == "ends":
                sys.exit("no petrol left")
            if fault == "sleeps":
                time.sleep(60)
            if fault == "babbles":
                say("left, I think")
                continue
            if fault == "nothing":
                say('{"steer": NaN}')
                continue
        speed = max(seen["v_x"], 1.0)
        ahead, left = seen["preview"][min(1 + int(0.35 * speed / seen["spacing"]), 8)]
        if seen["v_x"] < 0.3:  # what it turns at standstill
            say(json.dumps({"steer": seen["steer"]}))
            continue
        curvature = 2.0 * left / (ahead * ahead + left * left + 1e-9)
        say(json.dumps({"steer": max(-0.9, min(0.9, 2.5 * curvature))}))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "")
