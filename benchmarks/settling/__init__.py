"""The settling experiment: what decides whether I-FEM or the ELM is the more precise on curved paths.

Plan, tests and margins are fixed here before the first insertion of it is run.
"""
