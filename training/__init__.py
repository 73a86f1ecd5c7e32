"""Training of the networks that salframe ships. Run from the root of the repository; not part of the distribution."""
