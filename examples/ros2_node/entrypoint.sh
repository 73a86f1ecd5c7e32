#!/bin/sh
set -e
. /opt/ros/jazzy/setup.sh
. /opt/salframe/install/setup.sh
export PATH="/opt/salframe/env/bin:$PATH"
export PYTHONPATH="$(echo /opt/salframe/env/lib/python3*/site-packages):$PYTHONPATH"
exec "$@"
