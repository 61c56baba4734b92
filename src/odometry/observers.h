// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include <cstddef>
#include <stdexcept>
#include <vector>

namespace dsorb::odometry {

/// The observers of a run, called in the order in which they were added.
class Observers {
 public:
  /// @throws std::invalid_argument for a null pointer
  void add(OdometryObserver* observer) {
    if (observer == nullptr) throw std::invalid_argument("observer is null");
    observers_.push_back(observer);
  }
  /// Calls a method of every observer; one that is added by such a call hears of what comes then.
  template <typename Method, typename... Values>
  void notify(Method method, const Values&... values) const {
    const std::size_t count = observers_.size();
    for (std::size_t i = 0; i < count; ++i) (observers_[i]->*method)(values...);
  }
  /// Calls a method of every observer with the first keyframe, then with the next one.
  template <typename Method>
  void notifyEach(Method method, const std::vector<KeyframeSnapshot>& keyframes) const {
    for (const KeyframeSnapshot& keyframe : keyframes) notify(method, keyframe);
  }

 private:
  std::vector<OdometryObserver*> observers_;
};

}  // namespace dsorb::odometry
