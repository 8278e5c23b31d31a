"""Contact of needle and tissue: the channel of constraint points, their balls of tissue, the laws and the kernels."""
