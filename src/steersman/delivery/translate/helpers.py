"""Small functions in C, each written where something calls it."""

from importlib.resources import files

HELPERS = {
    "layer": (
        "/* weights (inputs, outputs) x values + bias. */\n"
        "static void layer(const real *weights, const real *bias, int inputs, int outputs,\n"
        "                  const real *values, real *sums)\n{\n    int i;\n    int j;\n\n"
        "    for (j = 0; j < outputs; ++j) {\n        sums[j] = bias[j];\n    }\n"
        "    for (i = 0; i < inputs; ++i, weights += outputs) {\n"
        "        const real x = values[i];\n\n"
        "        for (j = 0; j < outputs; ++j) {\n            sums[j] += weights[j] * x;\n"
        "        }\n    }\n}\n"
    ),
    "exact_layer": files("steersman.delivery.templates")
    .joinpath("exact_layer.c.in")
    .read_text(encoding="utf-8"),
    "least": "static real least(real a, real b)\n{\n    return b < a ? b : a;\n}\n",
    "most": "static real most(real a, real b)\n{\n    return b > a ? b : a;\n}\n",
    "least_int": "static int least_int(int a, int b)\n{\n    return b < a ? b : a;\n}\n",
    "most_int": "static int most_int(int a, int b)\n{\n    return b > a ? b : a;\n}\n",
    "to_int": (
        "/* Towards zero; numbers that no int can hold become the nearest one, NaN 0. */\n"
        "static int to_int(real x)\n{\n"
        "    if (x != x) {\n        return 0;\n    }\n"
        "    if (x >= (real)2.0e9) {\n        return 2000000000;\n    }\n"
        "    return x <= (real)-2.0e9 ? -2000000000 : (int)x;\n}\n"
    ),
    "floor_div": (
        "static int floor_div(int a, int b)\n{\n"
        "    return a / b - (a % b != 0 && (a < 0) != (b < 0) ? 1 : 0);\n}\n"
    ),
    "floor_mod": (
        "static int floor_mod(int a, int b)\n{\n"
        "    return a % b + (a % b != 0 && (a < 0) != (b < 0) ? b : 0);\n}\n"
    ),
    "finite": "static int finite_number(real x)\n{\n    return isfinite(x) ? 1 : 0;\n}\n",
    "copied": (
        "static void copied(real *to, const real *from, int count)\n{\n    int i;\n\n"
        "    for (i = 0; i < count; ++i) {\n        to[i] = from[i];\n    }\n}\n"
    ),
}
HELPER_NAMES = {"finite": "finite_number"}
RESERVED = {
    *(
        "parameters",
        "real",
        "limits",
        "step",
        "init",
        "reset",
        "executed",
        "hold",
        "signal",
        "slew",
    ),
    *("finite", "speed_limit", *HELPERS),
}
"""Names that no function made from Python has."""
