// SPDX-License-Identifier: BSD-3-Clause
// Runs the node without ROS: replay [PARAMETER=VALUE...]. Standard input has messages or calls,
// standard output what is published and answered, both as lines "NAME SIZE" (published ones "NAME
// TYPE SIZE") and SIZE bytes; a call is "call NAME".
#include "node.h"

#include <cstring>
#include <iostream>
#include <sstream>

namespace {

void write(const std::string& head, const std::vector<std::uint8_t>& bytes) {
  std::cout << head << ' ' << bytes.size() << '\n';
  std::cout.write(reinterpret_cast<const char*>(bytes.data()),
                  static_cast<std::streamsize>(bytes.size()));
}

void take(const std::string& line) {
  rclcpp::Graph& graph = rclcpp::graph();
  std::istringstream words(line);
  std::string name;
  words >> name;
  if (name == "call") {
    words >> name;
    const auto [success, text] = graph.services.at(name)();
    write(name + (success ? " ok" : " failed"), {text.begin(), text.end()});
    return;
  }
  std::size_t size = 0;
  words >> size;
  std::vector<std::uint8_t> bytes(size);
  std::cin.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  const auto found = graph.subscriptions.find(name);
  if (found != graph.subscriptions.end()) found->second(bytes.data(), size);
}

}  // namespace

int main(int argc, char** argv) try {
  rclcpp::Graph& graph = rclcpp::graph();
  for (int i = 1; i < argc; ++i) {
    const char* equals = std::strchr(argv[i], '=');
    if (equals == nullptr)
      throw std::invalid_argument(std::string(argv[i]) + ": expected PARAMETER=VALUE");
    graph.overrides[std::string(argv[i], static_cast<std::size_t>(equals - argv[i]))] = equals + 1;
  }
  graph.published =
      [](const std::string& topic, const char* type, const std::vector<std::uint8_t>& bytes) {
        write(topic + ' ' + type, bytes);
      };
  dsorb_ros::DsorbNode node;
  for (std::string line; std::getline(std::cin, line);) take(line);
  std::cout.flush();
  return 0;
} catch (const std::exception& error) {
  std::cerr << "replay: " << error.what() << '\n';
  return 1;
}
