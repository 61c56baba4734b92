// SPDX-License-Identifier: BSD-3-Clause
#include "app/progress_bar.h"

#include "platform/process.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <string>

namespace dsorb::app {
namespace {

constexpr int kBarWidth = 30;
constexpr std::chrono::milliseconds kRedrawInterval(100);

}  // namespace

ProgressBar::ProgressBar(int total, ProgressMode mode, bool quiet)
    : total_(total),
      enabled_(mode == ProgressMode::kOn ||
               (mode == ProgressMode::kAuto && !quiet && platform::errorIsTerminal())) {}

ProgressBar::~ProgressBar() {
  if (enabled_ && done_ > 0) std::fputc('\n', stderr);
}

void ProgressBar::update(const FrameEstimate& estimate, int dropped) {
  done_ += 1 + dropped - dropped_;
  dropped_ = dropped;
  const Clock::time_point now = Clock::now();
  if (enabled_ && (done_ == total_ || now - drawn_ >= kRedrawInterval)) draw(estimate, now);
}

/// The share that is done; the number of images alone where the end is not known (a camera).
std::string ProgressBar::share() const {
  if (total_ <= 0) return std::to_string(done_);
  const int filled = kBarWidth * std::min(done_, total_) / total_;
  return fmt::format("[{:<{}}] {}/{}",
                     std::string(static_cast<std::size_t>(filled), '#'),
                     kBarWidth,
                     done_,
                     total_);
}

void ProgressBar::draw(const FrameEstimate& estimate, Clock::time_point now) {
  drawn_ = now;
  const double seconds = std::chrono::duration<double>(now - begin_).count();
  const std::string line = fmt::format("\r{}  {:.1f} frames/s  segment {}  {:<12}",
                                       share(),
                                       done_ / std::max(seconds, 1e-3),
                                       estimate.segment,
                                       name(estimate.state));
  std::fputs(line.c_str(), stderr);  // a bar that nobody can see is no reason to end a run
  std::fflush(stderr);
}

}  // namespace dsorb::app
