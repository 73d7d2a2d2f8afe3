"""Configuration of a game: every number of the rules, the robot and the simulator, once, with unit and source."""

from .composition import PRESETS as PRESETS
from .composition import Config as Config
from .composition import differences as differences
from .composition import make_config as make_config
from .composition import parse_settings as parse_settings
from .composition import preset_names as preset_names
from .sections import EXECUTIONS as EXECUTIONS
from .sections import MAX_SPEED_MPS as MAX_SPEED_MPS
from .sections import ClydeConfig as ClydeConfig
from .sections import ExecutionConfig as ExecutionConfig
from .sections import LocalizationConfig as LocalizationConfig
from .sections import Nav2Config as Nav2Config
from .sections import ObservationConfig as ObservationConfig
from .sections import PelletConfig as PelletConfig
from .sections import PowerConfig as PowerConfig
from .sections import RandomizeConfig as RandomizeConfig
from .sections import RefugeConfig as RefugeConfig
from .sections import RewardConfig as RewardConfig
from .sections import RobotConfig as RobotConfig
from .sections import ShowConfig as ShowConfig
from .validation import ConfigError as ConfigError
from .validation import located as located
