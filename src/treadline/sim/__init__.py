"""A MuJoCo plant with native track surfaces and honest sensors."""
