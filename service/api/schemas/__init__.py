"""The JSON of requests and answers. The scenario itself is described once, in simcore."""
