// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include <functional>
#include <memory>
#include <string>

namespace dsorb {

/// Makes an initializer of somebody's own kind. It may be called from several threads at a time.
using InitializerFactory =
    std::function<std::unique_ptr<Initializer>(const InitializerOptions&, const PinholeCamera&)>;

/// As long as this object lives, `makeInitializer`, `Odometry`, configuration files and the command
/// line know an initializer by its name. A library brings one by a static object of this class; the
/// registry is the one thing in dsorb that the whole process shares, and several threads may use
/// it.
///
///     const dsorb::RegisteredInitializer kMine("mine", [](const auto& options, const auto& camera)
///     {
///       return std::make_unique<Mine>(options, camera);
///     });
class RegisteredInitializer {
 public:
  /// @throws std::invalid_argument where the name is empty or taken, or there is no factory
  RegisteredInitializer(std::string name, InitializerFactory factory);
  ~RegisteredInitializer();
  RegisteredInitializer(const RegisteredInitializer&) = delete;
  RegisteredInitializer& operator=(const RegisteredInitializer&) = delete;

 private:
  std::string name_;
};

}  // namespace dsorb
