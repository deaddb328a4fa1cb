"""A controller's FMU steers a car's: python co_simulation.py lqr.fmu carla_model3.fmu [SECONDS]."""

import sys
import tempfile
import zipfile

try:
    import fmpy
    from fmpy.simulation import instantiate_fmu
except ModuleNotFoundError:
    fmpy = None


def begin(file, folder):
    """An FMU at time 0, its description, and its variables by name."""
    about = fmpy.read_model_description(file)
    unit = instantiate_fmu(fmpy.extract(file, tempfile.mkdtemp(dir=folder)), about, "CoSimulation")
    if about.fmiVersion == "2.0":
        unit.setupExperiment(startTime=0.0)
        unit.getFloat64, unit.setFloat64 = unit.getReal, unit.setReal
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    return unit, about, {each.name: each for each in about.modelVariables}


def drive(controller_file, car_file, seconds):
    """Rows of time [s], lateral error [m] and steering command [-]."""
    with tempfile.TemporaryDirectory() as folder:
        controller, about, own = begin(controller_file, folder)
        car, _, its = begin(car_file, folder)
        period, rows = float(about.defaultExperiment.stepSize), []
        seen = [name for name in own if own[name].causality == "input" and name in its]
        inputs = [own[name].valueReference for name in seen]
        outputs = [its[name].valueReference for name in seen]
        answer, steering = own["steer_command"].valueReference, its["steer_command"].valueReference
        for step in range(round(seconds / period)):
            measured = car.getFloat64(outputs)
            controller.setFloat64(inputs, measured)  # what is observed at the step's beginning,
            controller.doStep(step * period, period)
            steer = controller.getFloat64([answer])  # is answered within the same step
            car.setFloat64([steering], steer)
            car.doStep(step * period, period)
            rows.append((step * period, measured[seen.index("lateral_error")], steer[0]))
        for unit in (controller, car):
            unit.terminate()
            unit.freeInstance()
    return rows


def arguments(words):
    """Both files and the seconds; wrong ones end the program with a line."""
    if fmpy is None:
        raise SystemExit(told("FMPy is not installed; pip install fmpy"))
    if len(words) not in {2, 3}:
        raise SystemExit(told("give two files: CONTROLLER.fmu CAR.fmu [SECONDS]"))
    for file, role in zip(words, ("output", "input"), strict=False):
        if not zipfile.is_zipfile(file):
            raise SystemExit(told(f"{file}: no such FMU; steersman export --to fmu writes one"))
        found = {v.name: v.causality for v in fmpy.read_model_description(file).modelVariables}
        if found.get("steer_command") != role:
            raise SystemExit(told(f"{file}: has no {role} steer_command; the controller is first"))
    seconds = words[2] if words[2:] else "20"
    if not seconds.replace(".", "", 1).isdecimal():
        raise SystemExit(told(f"{seconds!r} is no number of seconds"))
    return words[0], words[1], float(seconds)


def told(line):
    """The exit code of wrong arguments, after a line about them."""
    print(f"co_simulation.py: {line}", file=sys.stderr)  # noqa: T201
    return 2


if __name__ == "__main__":
    given = arguments(sys.argv[1:])
    print("time,lateral_error,steer_command")  # noqa: T201
    for row in drive(*given):
        print(",".join(f"{each:.9g}" for each in row))  # noqa: T201
