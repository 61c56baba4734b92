// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include "app/command_line.h"

#include <chrono>
#include <string>

namespace dsorb::app {

/// One line on stderr that shows how far a run is, redrawn at most ten times a second.
class ProgressBar {
 public:
  /// @param total number of images; 0: not known
  ProgressBar(int total, ProgressMode mode, bool quiet);
  /// Ends the line.
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  /// @param dropped images that were left out up to now
  void update(const FrameEstimate& estimate, int dropped);

 private:
  using Clock = std::chrono::steady_clock;
  void draw(const FrameEstimate& estimate, Clock::time_point now);
  [[nodiscard]] std::string share() const;

  int total_;
  bool enabled_;
  int done_ = 0;     // dropped images included
  int dropped_ = 0;  // images
  Clock::time_point begin_ = Clock::now();
  Clock::time_point drawn_;
};

}  // namespace dsorb::app
