"""An HTTP service that localizes queries in a map. It needs the optional packages of `salframe[serve]`."""
