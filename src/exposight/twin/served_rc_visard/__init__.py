"""The simulated cell served as an rc_visard: its REST interface and its images, on loopback."""

from exposight.twin.served_rc_visard.device import Misbehaviour
from exposight.twin.served_rc_visard.serving import ServedRcVisard
