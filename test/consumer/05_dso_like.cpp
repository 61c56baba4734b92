// SPDX-License-Identifier: BSD-3-Clause
// The fork of fork/, from its first image on, with a right start and with one that it has to
// refuse.
#include "fork/fork.h"
#include "images.h"

#include <dsorb/init/registry.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <utility>
#include <vector>

namespace {

constexpr int kBorder = 8;  // columns at the left that show nothing

/// `orb`, with near and far exchanged.
class Exchanged : public dsorb::Initializer {
 public:
  explicit Exchanged(std::unique_ptr<dsorb::Initializer> orb) : orb_(std::move(orb)) {}
  [[nodiscard]] dsorb::InitStep addFrame(dsorb::FramePtr frame) override {
    dsorb::InitStep step = orb_->addFrame(std::move(frame));
    if (!step.result) return step;
    for (dsorb::InitPoint& point : step.result->points) {
      point.inverse_depth = 1 / point.inverse_depth;
      point.variance *= std::pow(point.inverse_depth, 4.0F);
    }
    return step;
  }
  void reset() override { orb_->reset(); }

 private:
  std::unique_ptr<dsorb::Initializer> orb_;
};

/// As an undistorter of such a system leaves it: 0 where there is nothing.
std::vector<float> imageAt(int i) {
  const auto bytes = grabImage(i);
  std::vector<float> image(bytes.begin(), bytes.end());
  for (std::size_t p = 0; p < image.size(); ++p) image[p] = p % kWidth < kBorder ? 0 : image[p];
  return image;
}

struct Run {
  std::unique_ptr<fork::System> system;
  int refusals = 0, deleted = 0, most_frames = 0;
};

/// As a program of the fork does: a system that has failed is deleted, another one begins.
Run run(const dsorb::InitializerOptions& options, int images) {
  const dsorb::PinholeCamera camera{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight};
  Run run;
  for (int i = 0; i < images; ++i) {
    if (!run.system) {
      run.system = std::make_unique<fork::System>(
          camera, options, dsorb::DirectStartOptions(), run.refusals);
    }
    run.system->addActiveFrame(imageAt(i).data());
    run.most_frames = std::max(run.most_frames, fork::Frame::alive);
    if (!run.system->init_failed) continue;
    run.system.reset();
    ++run.deleted;
  }
  return run;
}

/// @return whether a keyframe has the pixels that were given with its image, and points where these
///         show something
bool isSound(const fork::System& system) {
  const fork::Frame& front = *system.window.front();
  const std::vector<float> image = imageAt(front.shell->number);
  const auto same = [](float given, const fork::Grey& grey) { return grey[0] == given; };
  bool sound = std::equal(image.begin(), image.end(), front.levels[0].pixels.begin(), same);
  for (const auto& point : system.points)
    sound = sound && (!point.second.has_prior || point.second.u >= kBorder + 2);
  return sound;
}

/// The true path is straight and even. @return whether the found one is
bool isTrue(const fork::System& system) {
  std::size_t first = 0;
  while (first + 1 < system.history.size() && !system.history[first]->valid) ++first;
  const auto way = [&](std::size_t k) -> Eigen::Vector3d {
    return system.history[k]->pose.inverse().translation() -
           system.history[first]->pose.inverse().translation();
  };
  const std::size_t last = system.history.size() - 1, half = (last - first) / 2;
  if (half < 10) return false;
  const Eigen::Vector3d all = way(last);
  const double angle = std::atan2(all.head<2>().norm(), all.z()) * 180 / 3.14159265;
  const double even = way(first + half).norm() / all.norm() * static_cast<double>(last - first) /
                      static_cast<double>(half);
  std::printf(
      "%zu keyframes, %zu points, residual %.2f grey levels; %.2f degrees off the axis "
      "(true: 63.43), first half %.4f of its length\n",
      system.window.size(),
      system.points.size(),
      system.rms,
      angle,
      even);
  return std::abs(angle - 63.43) < .5 && std::abs(even - 1) < .02;
}

}  // namespace

int main() {
  const Run right = run({}, 24);
  const bool stays =
      right.deleted == 0 && right.refusals == 0 && isTrue(*right.system) && isSound(*right.system);
  // Images are kept by the window and the newest one alone.
  const bool deletes = right.most_frames <= 9;

  const dsorb::RegisteredInitializer registered("exchanged", [](const auto&, const auto& camera) {
    return std::make_unique<Exchanged>(dsorb::makeInitializer({}, camera));
  });
  dsorb::InitializerOptions options;
  options.kind = dsorb::InitializerKind::kRegistered;
  options.registered = "exchanged";
  const Run wrong = run(options, 10);
  std::printf(
      "with near and far exchanged %d systems were deleted before one stayed; at most %d images "
      "were kept\n",
      wrong.deleted,
      right.most_frames);
  // Two starts are refused in a row; the next one stays, and the count begins anew.
  const bool refuses = wrong.deleted == 2 && wrong.refusals == 0;
  return stays && deletes && refuses ? 0 : 1;
}
