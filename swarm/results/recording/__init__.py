"""The recording of a run for the rerun viewer."""

import os

# rerun logs by itself what `Canvas` raises, such as a full disk; whoever sets the variable sees that too.
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off,re_sdk::recording_stream=off")
