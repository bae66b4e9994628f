"""The paper's experiments, each from scenario to run folder."""
