"""Ask a node a thousand times a second, in lines of JSON: python node_client.py PORT [COUNT]."""

import json
import socket
import sys
import time


def ask(port, count):
    """Round trips [s], and the last answer."""
    node = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    node.connect(("127.0.0.1", port))
    node.settimeout(1.0)
    times, answer = [], {}
    begun = time.perf_counter()
    for sequence in range(count):
        seen = {
            "sequence": sequence,
            "time": 0.001 * sequence,
            "lateral_error": 0.1,  # the car is 0.1 m left of a straight road
            "heading_error": 0.0,
            "v_x": 10.0,
            "v_y": 0.0,
            "yaw_rate": 0.0,
            "steer": answer.get("steer", 0.0),
            "curvature": 0.0,
            "preview": [[2.0 * i, -0.1] for i in range(15)],
            "spacing": 2.0,
        }
        sent = time.perf_counter()
        node.send(json.dumps(seen).encode())
        answer = json.loads(node.recv(1000))
        times.append(time.perf_counter() - sent)
        time.sleep(max(begun + 0.001 * (sequence + 1) - time.perf_counter(), 0.0))
    node.close()
    return times, answer


def main(words):
    """Ask, and print how long answers took; the exit code."""
    if len(words) not in {1, 2} or not all(w.isdecimal() and int(w) > 0 for w in words):
        return told("give the port of a node, and how often to ask: PORT [COUNT]")
    try:
        found, last = ask(int(words[0]), int((*words, "1000")[1]))
    except (OSError, OverflowError) as error:
        return told(f"no node answers on port {words[0]} ({error})")
    found.sort()
    median, p99 = (1e3 * found[int(share * len(found))] for share in (0.5, 0.99))
    print(f"{last}: {median:.3f} ms in half of the round trips, {p99:.3f} ms in 99 %")  # noqa: T201
    return 0


def told(line):
    """The exit code of wrong arguments, after a line about them."""
    print(f"node_client.py: {line}", file=sys.stderr)  # noqa: T201
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
