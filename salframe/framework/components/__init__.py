"""Registration, names, configuration, automatic choice and identity of components."""
