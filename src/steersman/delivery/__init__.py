"""What leaves Steersman: a policy as C source or as a checked ONNX file, each with a card."""
