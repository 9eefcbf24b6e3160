"""What describers with pretrained networks share: weights, input, hub repositories, ONNX's TOML."""
