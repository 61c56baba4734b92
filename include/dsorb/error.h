// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

#include <stdexcept>

/// Direct visual odometry with feature-based initialization.
namespace dsorb {

/// An option that is unknown, has the wrong type or lies out of range; the message names file,
/// line, full key, what was expected and the closest valid key.
class ConfigError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A data set, calibration or output file that cannot be read or written; the message names file,
/// line and what was expected.
class IoError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace dsorb
