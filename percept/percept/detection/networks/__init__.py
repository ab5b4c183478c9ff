"""A network in ONNX: opened safely, its layout told from its tensors, its output decoded."""
