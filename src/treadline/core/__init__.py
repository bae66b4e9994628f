"""Words that every room speaks: signals, models, ports, errors, settings, angles. Imports nothing of treadline above itself."""
