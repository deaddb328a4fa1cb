"""A network in C: constants, activations, and the calls layer by layer."""

from __future__ import annotations

from steersman.delivery import c_text
from steersman.delivery.graph import CLIP, NONE, RELU, TANH, Network

_FUNCTIONS = {RELU: "relu", TANH: "squash", CLIP: "clip_all"}
_ACTIVATIONS = {
    RELU: """static void relu(float *values, float *lows, int count)
{
    int i;

    for (i = 0; i < count; ++i) {
        if (!(values[i] > 0.0f)) {
            values[i] = 0.0f;
            lows[i] = 0.0f;
        }
    }
}
""",
    TANH: """static void squash(float *values, float *lows, int count)
{
    int i;

    for (i = 0; i < count; ++i) {
        values[i] = tanhf(values[i]);
        lows[i] = 0.0f;
    }
}
""",
    CLIP: """static void clip_all(float *values, float *lows, int count)
{
    int i;

    for (i = 0; i < count; ++i) {
        values[i] = clip(values[i], 1.0f);
        lows[i] = 0.0f;
    }
}
""",
}


def arrays(network: Network) -> str:
    """The constants; weights stand input by input, so that inner loops run along memory."""
    out = ["/* Factor on each feature. */\n" + c_text.array("scale", network.scale)]
    for i, layer in enumerate(network.layers, 1):
        outputs, inputs = layer.weights.shape
        out += [
            f"\n/* {inputs} inputs x {outputs} outputs. */\n"
            + c_text.array(f"weights_{i}", layer.weights.T.ravel()),
            c_text.array(f"bias_{i}", layer.bias),
        ]
    return "".join(out)


def activations(network: Network) -> str:
    """The functions of the activations that occur."""
    used = {layer.activation for layer in network.layers}
    return "\n".join(text for each, text in _ACTIVATIONS.items() if each in used)


def layers(network: Network) -> str:
    """The calls from the scaled features in ``a`` to the action."""
    lines, here, there = [], "a", "b"
    for i, layer in enumerate(network.layers, 1):
        outputs, inputs = layer.weights.shape
        given, made = f"{here}, {here}_low", f"{there}, {there}_low"
        lines.append(f"layer(weights_{i}, bias_{i}, {inputs}, {outputs}, {given}, {made});")
        if layer.activation != NONE:
            lines.append(f"{_FUNCTIONS[layer.activation]}({made}, {outputs});")
        here, there = there, here
    lines.append(f"action[0] = {here}[0];")
    return "".join(f"    {line}\n" for line in lines)
