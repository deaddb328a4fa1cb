"""Files of public projects, used as their owners would: what is driven, what is refused and why.

    python benchmarks/foreign_files.py --checkouts DIR [--out results/foreign_files]

``DIR`` has a folder OWNER+NAME for each repository of FILES on GitHub, with its files; none of them
is part of this project. Each command runs in a process of its own, in an empty folder.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from steersman.files import write_text
from steersman.provenance import provenance

DRIVE = "drive path={} speed=constant_speed speed.speed=5 speed.a_lat_max=3 duration=10"
CHECK, RANDOM = "path check {}", f"{DRIVE} path.random=1 path.distance=60"
LIST = "adopt {} --encoding list encoding.features=[lateral_error,heading_error,v_x] --out adopted"
LIST_4 = LIST.replace("v_x]", "v_x,yaw_rate]")
SMOOTH, TWO = f"{DRIVE} path.smoothing=auto", f"{DRIVE} path.columns=x=1,y=2"
QC, CR = "tests/data/", "tests/map_conversion/test_maps/"
FILES: dict[str, dict[str, tuple[str, ...]]] = {
    "esmini/esmini": {
        "resources/xodr/fabriksgatan.xodr": (CHECK, RANDOM),
        "resources/xodr/multi_intersections.xodr": (CHECK, RANDOM),
        "resources/xodr/parking_demo.xodr": (CHECK, RANDOM),
        "EnvironmentSimulator/Unittest/xodr/straight_road.xodr": (CHECK, RANDOM),
        "EnvironmentSimulator/Unittest/xodr/curve_road_mixed.xodr": (CHECK, RANDOM),
        "resources/sumo_inputs/fabriksgatan.net.xml": (DRIVE,),
    },
    "carla-simulator/opendrive-test-files": {
        "OpenDrive/Town02.xodr": (CHECK, RANDOM),
        "OpenDrive/Town03.xodr": (CHECK, RANDOM),
        "OpenDrive/Town06.xodr": (CHECK, RANDOM),
    },
    "pageldev/libOpenDRIVE": {"tests/test.xodr": (CHECK, RANDOM)},
    "asam-ev/qc-opendrive": {
        f"{QC}examples/Ex_Entry_Exit.xodr": (CHECK, RANDOM),
        f"{QC}performance_avoid_redundant_info/"
        "performance_avoid_redundant_info_elevation_valid.xodr": (CHECK, f"{DRIVE} path.road=1"),
        f"{QC}road_geometry_elem_asc_order/invalid.xodr": (CHECK, RANDOM),
        f"{QC}valid_schema/negative17.xodr": (CHECK,),
        f"{QC}valid_xml_document/xml.valid_xml_document.negative.xodr": (CHECK,),
    },
    "MarcelBruckner-TUMProjects/OpenDRIVE": {"misc/test_map_opendrive_1_6.xodr": (CHECK, RANDOM)},
    "minhanghuang/opendrive-cpp": {
        "tests/data/UC_Simple-X-Junction.xodr": (CHECK, RANDOM),
        "tests/data/Ex_Simple-LaneOffset.xodr": (CHECK, RANDOM),
    },
    "CommonRoad/commonroad-scenario-designer": {
        f"{CR}odr2cr/straight_road_default.xodr": (CHECK,),
        f"{CR}odr2cr/poly3_and_border_record.xodr": (CHECK, RANDOM),
        f"{CR}odr2cr/MONAEast.xodr": (CHECK, RANDOM),
        f"{CR}cr2odr/reference_xodr_files/ZAM_CurvedLanelet-1_1_T-1.xodr": (
            f"{DRIVE} path.road=21",
        ),
        f"{CR}cr2odr/reference_xodr_files/DEU_Muehlhausen-2_2_T-1.xodr": (CHECK, RANDOM),
        f"{CR}lanelet2/merging_lanelets_utm.osm": (
            "path roads {}",
            f"{DRIVE} path.route=[-380,-390]",
        ),
        f"{CR}osm/munich.osm": (f"{DRIVE} path.route=[1]",),
    },
    "fzi-forschungszentrum-informatik/Lanelet2": {
        "lanelet2_maps/res/mapping_example.osm": (
            "path roads {}",
            f"{DRIVE} path.route=[9187600893603114095,9037740909199276460]",
        ),
    },
    "tier4/autoware_lanelet2_to_opendrive": {
        "autoware_lanelet2_to_opendrive/test/data/speed_change_mini.osm": (
            f"{DRIVE} path.route=[5001,5002]",
        ),
        "autoware_lanelet2_to_opendrive/test/data/walkway_mini.osm": ("path roads {}",),
    },
    "CommonRoad/commonroad-io": {"tests/test_scenarios/DEU_A9-3_1_T-1.xml": (DRIVE,)},
    "TUMFTM/racetrack-database": {
        "racelines/Norisring.csv": (DRIVE,),
        "tracks/Spa.csv": (DRIVE,),
        "tracks/Zandvoort.csv": (DRIVE,),
    },
    "TUMFTM/global_racetrajectory_optimization": {
        "inputs/tracks/berlin_2018.csv": (DRIVE,),
        "inputs/tracks/modena_2019.csv": (DRIVE,),
        "inputs/frictionmaps/rounded_rectangle_tpamap.csv": (DRIVE,),
    },
    "f1tenth/f1tenth_racetracks": {
        "IMS/IMS_raceline.csv": (DRIVE,),
        "Spielberg/Spielberg_centerline.csv": (DRIVE,),
    },
    "f1tenth/f1tenth_planning": {
        "examples/control/levine_centerline.csv": (DRIVE,),
        "examples/control/levine_raceline.csv": (DRIVE, SMOOTH),
    },
    "autorope/donkeycar": {
        "donkeycar/utilities/TrackSpeedPlanner/test_path.csv": (DRIVE, TWO),
    },
    "carla-simulator/scenario_runner": {"srunner/examples/resources/ego_logs.csv": (DRIVE, TWO)},
    "alexliniger/MPCC": {
        "C++/Params/track.json": (DRIVE,),
        "Matlab/Tracks/track2.mat": (DRIVE,),
    },
    "ForzaETH/race_stack": {"stack_master/maps/f/global_waypoints.json": (DRIVE,)},
    "tkrajina/gpxpy": {
        "test_files/around-visnjan-with-car.gpx": (DRIVE,),
        "test_files/cerknicko-jezero.gpx": (DRIVE,),
        "test_files/route.gpx": (DRIVE,),
        "test_files/track_with_speed.gpx": (DRIVE,),
        "test_files/track-with-small-floats.gpx": (DRIVE,),
        "test_files/Mojstrovka.gpx": (DRIVE, f"{DRIVE} path.loop=false"),
        "test_files/unicode.gpx": (DRIVE,),
    },
    "bacinger/f1-circuits": {
        "circuits/be-1925.geojson": (DRIVE,),
        "circuits/au-1953.geojson": (DRIVE,),
        "circuits/bh-2002.geojson": (DRIVE,),
    },
    "ros2/rosbag2": {
        "rosbag2_py/test/resources/mcap/talker/talker.mcap": (DRIVE,),
        "rosbag2_py/test/resources/sqlite3/talker/talker.db3": (DRIVE,),
    },
    "foxglove/mcap": {"testdata/mcap/demo.mcap": (DRIVE,)},
    "DLR-RM/rl-trained-agents": {
        "ppo/Pendulum-v1_1/Pendulum-v1.zip": (LIST,),
        "sac/Pendulum-v1_1/Pendulum-v1.zip": (LIST,),
        "ddpg/Pendulum-v1_1/Pendulum-v1.zip": (LIST,),
        "tqc/Pendulum-v1_1/Pendulum-v1.zip": (LIST,),
        "dqn/CartPole-v1_1/CartPole-v1.zip": (LIST_4,),
    },
}


def main() -> None:
    """Every command, and the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--checkouts", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path("results/foreign_files"))
    parser.add_argument("--jobs", type=int, default=4)
    words = parser.parse_args()
    jobs = [
        (repository, name, words.checkouts.resolve() / repository.replace("/", "+") / name, command)
        for repository, files in FILES.items()
        for name, commands in files.items()
        for command in commands
    ]
    with ThreadPoolExecutor(words.jobs) as pool:
        rows = list(pool.map(lambda job: ran(*job), jobs))
    counts = {
        "files": sum(len(files) for files in FILES.values()),
        "repositories": len(FILES),
        "commands": len(rows),
        "refused": sum(row["exit"] == 2 for row in rows),  # noqa: PLR2004 - the exit code
        "tracebacks": sum(bool(row["traceback"]) for row in rows),
    }
    command = "python benchmarks/foreign_files.py --checkouts DIR"
    record = {"made": {"command": command, **provenance()}, **counts, "rows": rows}
    write_text(words.out / "table.json", json.dumps(record, indent=1) + "\n")
    sys.stdout.write(json.dumps(counts) + "\n")


def ran(repository: str, name: str, file: Path, command: str) -> dict[str, object]:
    """One row: a command on a file, its exit code and what was told."""
    code = "from steersman.cli import main; main()"
    arguments = [word.format(file) for word in command.split()]
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
    told = [line.replace(f"{file}", file.name) for line in done.stderr.splitlines() if line.strip()]
    row: dict[str, object] = {
        "repository": repository,
        "path": name,
        "command": f"steersman {command.format(file.name)}",
        "exit": done.returncode,
        "told": [line[:300] for line in told[-3:]],
        "traceback": "Traceback" in done.stderr or done.returncode not in {0, 1, 2},
    }
    sys.stdout.write(json.dumps(row) + "\n")
    sys.stdout.flush()
    return row


if __name__ == "__main__":
    main()
