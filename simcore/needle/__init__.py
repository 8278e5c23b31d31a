"""The needle: co-rotational beams and the curve of the shaft between their nodes."""
