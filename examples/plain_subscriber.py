"""Prints where the cables are, with zenoh and msgpack alone: python plain_subscriber.py tcp/127.0.0.1:7450 cell1"""

import json
import sys

import msgpack
import numpy as np
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config) as session:
    states = session.declare_subscriber(f"motiondlo/{sys.argv[2]}/state", zenoh.handlers.RingChannel(1))
    for sample in states:
        state = msgpack.unpackb(sample.payload.to_bytes())
        for dlo in state["dlos"]:
            nodes = np.frombuffer(dlo["nodes"]["data"], dlo["nodes"]["dtype"]).reshape(dlo["nodes"]["shape"])
            sys.stdout.write(f"{state['t_us']} {state['mode']} {dlo['id']} {dlo['confidence']:.2f} {nodes.tolist()}\n")
            sys.stdout.flush()
