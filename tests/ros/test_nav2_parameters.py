"""What the tool reads out of sources such as Nav2's."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from tests.ros import nav2_parameters

LAYER = """
// declareParameter("in_a_comment", 1);
class SpotLayer : public Layer {
};
void SpotLayer::onInitialize()
{
  declareParameter("enabled", rclcpp::ParameterValue(true));
  declareParameter(source + "." + "range", rclcpp::ParameterValue(2.5));
  node->get_parameter("read_only", value);
}
Layer::Layer()
{
  nav2_util::declare_parameter_if_not_declared(
    node, name_ + ".height", rclcpp::ParameterValue(std::string("low, or not")));
}
"""
CRITIC = """
void Optimizer::getParams()
{
  auto getParam = parameters_handler_->getParamGetter(name_);
  auto getParentParam = parameters_handler_->getParamGetter(parent_name_);
  getParam(s.steps, "steps", 56);
  getParentParam(s.speed, "speed", 0.5f);
}
void TrajectoryVisualizer::on_configure()
{
  auto getParam = parameters_handler->getParamGetter(name + ".TrajectoryVisualizer");
  getParam(step_, "step", 5, ParameterType::Static);
}
"""
SERVER = """
PlannerServer::PlannerServer(const rclcpp::NodeOptions & options)
: nav2_util::LifecycleNode("planner_server", "", options)
{
  declare_parameter("planner_plugins", default_ids_);
  declare_parameter<double>("frequency", -1.0);
  declare_parameter("limits", std::vector<double>{0.5, 0.0, 2.0});
}
"""
FILES = {
    "navigation2/package.xml": "<package><version>1.3.99</version></package>",
    "nav2_spots/src/spot_layer.cpp": LAYER,
    "nav2_spots/test/spot_layer.cpp": 'void SpotLayer::test() { declareParameter("of_a_test", 1); }',
    "nav2_spots/plugins.xml": '<library><class type="spots::SpotLayer" base_class_type="spots::Layer"/></library>',
    "nav2_mppi_controller/src/optimizer.cpp": CRITIC,
    "nav2_mppi_controller/mppic.xml": '<class\n  name="mppi::Controller" type="mppi::MPPIController&lt;&gt;"/>',
    "nav2_planner/src/planner_server.cpp": SERVER,
    "config/nav2.yaml": "{costs: {costs: {ros__parameters: {up: {by: 1}}}}, server: {ros__parameters: {a: [1]}}}",
}


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        path = tmp_path / "sources" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    git = ["git", "-C", str(tmp_path / "sources"), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "--quiet"], ["add", "."], ["commit", "--quiet", "-m", "all"]):
        subprocess.run([*git, *words], check=True)
    return tmp_path / "sources"


def test_the_tool_writes_names_defaults_and_the_commit(sources: Path, tmp_path: Path) -> None:
    written = tmp_path / "parameters.json"
    given = ["--sources", str(sources), "--turtlebot", str(sources), "--output", str(written)]
    assert nav2_parameters.main(given) == 0
    content = json.loads(written.read_text())
    head = subprocess.run(["git", "-C", str(sources), "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
    assert content["source"]["commit"] == content["turtlebot4"]["commit"] == head.stdout.strip()
    assert content["source"]["version"] == "1.3.99"
    layer = content["plugins"]["spots::SpotLayer"]
    assert layer == {"of_node": {}, "parameters": {"enabled": True, "*.range": 2.5, "height": "low, or not"}}
    assert content["plugins"]["mppi::Controller"]["parameters"] == {"steps": 56, "TrajectoryVisualizer.step": 5}
    planner = content["nodes"]["planner_server"]
    assert planner == {"use_sim_time": False, "planner_plugins": None, "frequency": -1.0, "limits": [0.5, 0.0, 2.0]}
    assert content["turtlebot4"]["values"] == {"costs": {"up.by": 1}, "server": {"a": [1]}}


def test_without_turtlebots_sources_its_values_stay(sources: Path, tmp_path: Path) -> None:
    written = tmp_path / "parameters.json"
    written.write_text('{"turtlebot4": {"commit": "c", "values": {}}}')
    assert nav2_parameters.main(["--sources", str(sources), "--output", str(written)]) == 0
    assert json.loads(written.read_text())["turtlebot4"] == {"commit": "c", "values": {}}


def test_what_is_no_repository_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert nav2_parameters.main(["--sources", str(tmp_path / "nowhere")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
