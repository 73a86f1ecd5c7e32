"""An HTTP service that localizes queries in an open map. It needs the extra `serve`."""
