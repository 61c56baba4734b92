// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "cdr.h"

#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

/// The few declarations of rclcpp that dsorb_ros uses, for a test without ROS: what a node publishes goes to one function, and
/// Graph::deliver calls its subscriptions with messages as the wire has them.
namespace rclcpp {

struct Graph {
  std::function<void(const std::string& topic, const char* type, const std::vector<std::uint8_t>& bytes)> published;
  std::map<std::string, std::function<void(const std::uint8_t*, std::size_t)>> subscriptions;
  std::map<std::string, std::function<std::pair<bool, std::string>()>> services;
  std::map<std::string, std::string> overrides;  ///< of parameters, as YAML has them
};
inline Graph& graph() {
  static Graph only;
  return only;
}

class Parameter {
 public:
  explicit Parameter(std::string value) : value_(std::move(value)) {}
  [[nodiscard]] std::string value_to_string() const { return value_; }
  [[nodiscard]] std::string as_string() const { return value_; }
  [[nodiscard]] std::int64_t as_int() const { return std::stoll(value_); }
  [[nodiscard]] bool as_bool() const { return value_ == "true"; }

 private:
  std::string value_;
};

class NodeOptions {
 public:
  NodeOptions& automatically_declare_parameters_from_overrides(bool /*value*/) { return *this; }
};
class QoS {
 public:
  QoS(int /*depth*/) {}
  QoS& keep_last(int /*depth*/) { return *this; }
};
class SensorDataQoS : public QoS {
 public:
  SensorDataQoS() : QoS(5) {}
};

template <typename Message>
class Publisher {
 public:
  using SharedPtr = std::shared_ptr<Publisher>;
  explicit Publisher(std::string topic) : topic_(std::move(topic)) {}
  void publish(const Message& message) {
    cdr::Writer writer;
    Message copy = message;
    writer(copy);
    graph().published(topic_, Message::kName, writer.bytes);
  }

 private:
  std::string topic_;
};
template <typename Message>
class Subscription {
 public:
  using SharedPtr = std::shared_ptr<Subscription>;
};
template <typename Kind>
class Service {
 public:
  using SharedPtr = std::shared_ptr<Service>;
};

struct Logger {};
inline Logger get_logger(const char* /*name*/) { return {}; }

struct ListParametersResult {
  std::vector<std::string> names;
};

class Node {
 public:
  Node(const char* /*name*/, const NodeOptions& /*options*/) {}
  virtual ~Node() = default;
  [[nodiscard]] Logger get_logger() const { return {}; }
  [[nodiscard]] bool has_parameter(const std::string& name) const { return graph().overrides.count(name) != 0; }
  [[nodiscard]] Parameter get_parameter(const std::string& name) const { return Parameter(graph().overrides.at(name)); }
  [[nodiscard]] ListParametersResult list_parameters(const std::vector<std::string>& /*prefixes*/, std::uint64_t /*depth*/) const {
    ListParametersResult result;
    for (const auto& [name, value] : graph().overrides) result.names.push_back(name);
    return result;
  }
  template <typename Message>
  std::shared_ptr<Publisher<Message>> create_publisher(const std::string& topic, const QoS& /*qos*/) {
    return std::make_shared<Publisher<Message>>(topic);
  }
  template <typename Message, typename Callback>
  std::shared_ptr<Subscription<Message>> create_subscription(const std::string& topic, const QoS& /*qos*/, Callback callback) {
    graph().subscriptions[topic] = [callback](const std::uint8_t* data, std::size_t size) {
      auto message = std::make_shared<Message>();
      cdr::Reader reader(data, size);
      reader(*message);
      callback(std::shared_ptr<const Message>(message));
    };
    return std::make_shared<Subscription<Message>>();
  }
  template <typename Kind, typename Callback>
  std::shared_ptr<Service<Kind>> create_service(const std::string& name, Callback callback) {
    graph().services[name] = [callback] {
      auto response = std::make_shared<typename Kind::Response>();
      callback(std::make_shared<typename Kind::Request>(), response);
      return std::make_pair(response->success, response->message);
    };
    return std::make_shared<Service<Kind>>();
  }
};

}  // namespace rclcpp

#define DSORB_STUB_LOG(level, logger, ...) \
  do {                                     \
    (void)(logger);                        \
    std::fprintf(stderr, level ": ");      \
    std::fprintf(stderr, __VA_ARGS__);     \
    std::fputc('\n', stderr);              \
  } while (false)
#define DSORB_STUB_ONCE(level, logger, ...)              \
  do {                                                   \
    static bool said = false;                            \
    if (!said) DSORB_STUB_LOG(level, logger, __VA_ARGS__); \
    said = true;                                         \
  } while (false)
#define RCLCPP_WARN(...) DSORB_STUB_LOG("warning", __VA_ARGS__)
#define RCLCPP_ERROR(...) DSORB_STUB_LOG("error", __VA_ARGS__)
#define RCLCPP_FATAL(...) DSORB_STUB_LOG("fatal", __VA_ARGS__)
#define RCLCPP_WARN_ONCE(...) DSORB_STUB_ONCE("warning", __VA_ARGS__)
#define RCLCPP_ERROR_ONCE(...) DSORB_STUB_ONCE("error", __VA_ARGS__)
