// SPDX-License-Identifier: BSD-3-Clause
// Public types have the same layout whatever instruction set a program is compiled for.
#include <dsorb/camera/calibration.h>
#include <dsorb/image/frame_priors.h>
#include <dsorb/init/start_judge.h>
#include <dsorb/odometry/observer.h>
#include <dsorb/odometry/odometry.h>

namespace {

template <typename T, std::size_t kSize, std::size_t kAlignment>
constexpr bool hasLayout() {
  static_assert(sizeof(T) == kSize && alignof(T) == kAlignment, "the binary interface has changed");
  return true;
}

// Sizes with GCC's and clang's standard library on x86-64.
constexpr bool kSame =
    hasLayout<dsorb::SE3, 56, 8>() && hasLayout<dsorb::Vector6d, 48, 8>() &&
    hasLayout<dsorb::Matrix6d, 288, 8>() && hasLayout<dsorb::PinholeCamera, 48, 8>() &&
    hasLayout<dsorb::PosedFrame, 392, 8>() && hasLayout<dsorb::InitPoint, 24, 4>() &&
    hasLayout<dsorb::InitializationResult, 272, 8>() && hasLayout<dsorb::InitStep, 664, 8>() &&
    hasLayout<dsorb::MapPoint, 20, 4>() && hasLayout<dsorb::FrameEstimate, 800, 8>() &&
    hasLayout<dsorb::KeyframeSnapshot, 296, 8>() && hasLayout<dsorb::FramePriors, 472, 8>() &&
    hasLayout<dsorb::PosePrior, 360, 8>() && hasLayout<dsorb::FrameInfo, 72, 8>() &&
    hasLayout<dsorb::InitReport, 144, 8>() && hasLayout<dsorb::StartPose, 112, 8>() &&
    hasLayout<dsorb::RowTimes, 104, 8>() && hasLayout<dsorb::Calibration, 272, 8>() &&
    hasLayout<dsorb::OdometryOptions, 408, 8>();

}  // namespace

int main() {
  return kSame ? 0 : 1;
}
