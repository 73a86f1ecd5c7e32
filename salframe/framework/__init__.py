"""What everything else stands on: components, their settings and identity, how they are found, files, weights. Knows no
role."""
