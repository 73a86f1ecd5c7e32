"""What trains the networks that salframe ships, run from the repository's root; no part of the distribution."""
