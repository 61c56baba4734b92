// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/report.h"

#include <type_traits>
#include <utility>
#include <variant>

namespace dsorb::init_orb {

/// Result of a stage, or the reason why there is none.
template <typename T>
class Outcome {
 public:
  Outcome(T&& made) : state_(std::move(made)) {}  // implicit: a stage returns what it made,
  Outcome(InitReason reason) : state_(reason) {}  // or its reason

  explicit operator bool() const { return state_.index() == 0; }
  [[nodiscard]] InitReason reason() const {
    return *this ? InitReason::kDone : std::get<1>(state_);
  }
  T& operator*() { return std::get<0>(state_); }
  T* operator->() { return &std::get<0>(state_); }

  /// Passes the result to the next stage; without a result the reason is passed on.
  template <typename Stage>
  std::invoke_result_t<Stage, T> then(Stage&& stage) && {
    if (!*this) return reason();
    return std::forward<Stage>(stage)(std::move(**this));
  }

 private:
  std::variant<T, InitReason> state_;
};

}  // namespace dsorb::init_orb
