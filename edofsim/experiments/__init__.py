"""How good an image is, and the experiments of the paper."""
