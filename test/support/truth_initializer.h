// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include <algorithm>
#include <functional>
#include <stdexcept>
#include <utility>
#include <vector>

namespace dsorb {

/// Where frames really are and what they see; frames are named by their id.
struct Truth {
  std::function<SE3(int)> T_world_cam;
  std::function<std::vector<float>(int)> inverse_depth;  ///< row-major; not positive: none
};

/// An initializer that is told the truth: true poses, true inverse depths on the strongest gradient
/// of every cell of the reference. An example of how anybody's own initializer enters Odometry.
class TruthInitializer : public Initializer {
 public:
  TruthInitializer(const PinholeCamera& camera, Truth truth, int frames = 5, int cell = 8)
      : camera_(camera), truth_(std::move(truth)), frames_(frames), cell_(cell) {}

  [[nodiscard]] InitStep addFrame(FramePtr frame) override {
    if (is_spent_) throw std::logic_error("addFrame after a result");
    fed_.push_back(std::move(frame));
    InitStep step;
    if (static_cast<int>(fed_.size()) < frames_) return step;
    is_spent_ = true;
    step.status = InitStatus::kInitialized;
    step.reason = InitReason::kDone;
    step.result = makeResult();
    return step;
  }
  void reset() override {
    fed_.clear();
    is_spent_ = false;
  }

 private:
  [[nodiscard]] InitializationResult makeResult() const {
    const int reference = fed_.front()->id().value;
    InitializationResult result;
    result.points = makePoints(truth_.inverse_depth(reference));
    double sum = 0;
    for (const InitPoint& point : result.points) sum += static_cast<double>(point.inverse_depth);
    const double unit = static_cast<double>(result.points.size()) / sum;
    for (InitPoint& point : result.points) point.inverse_depth *= static_cast<float>(unit);
    for (const FramePtr& frame : fed_) {
      SE3 T_cam_ref =
          truth_.T_world_cam(frame->id().value).inverse() * truth_.T_world_cam(reference);
      if (frame == fed_.front()) T_cam_ref = SE3();
      T_cam_ref.setTranslation(T_cam_ref.translation() / unit);
      result.frames.push_back({frame, T_cam_ref, {}, {}});
    }
    result.report.model = "truth";
    return result;
  }

  [[nodiscard]] std::vector<InitPoint> makePoints(const std::vector<float>& inverse_depth) const {
    constexpr int kBorder = 4;               // [px]
    constexpr float kMinGradient2 = 7 * 7;   // [grey levels^2 / px^2]
    constexpr float kRelativeSigma = 0.01F;  // claimed
    const PyramidLevel& image = fed_.front()->level(0);
    std::vector<InitPoint> points;
    for (int y0 = kBorder; y0 + cell_ < camera_.height - kBorder; y0 += cell_) {
      for (int x0 = kBorder; x0 + cell_ < camera_.width - kBorder; x0 += cell_) {
        float best = kMinGradient2;
        InitPoint point;
        for (int y = y0; y < y0 + cell_; ++y) {
          for (int x = x0; x < x0 + cell_; ++x) {
            const ImageSample sample = image.at(x, y);
            const float strength = sample.dx * sample.dx + sample.dy * sample.dy;
            const float rho = inverse_depth[static_cast<std::size_t>(y * camera_.width + x)];
            if (strength <= best || rho <= 0) continue;
            best = strength;
            point.pixel = {static_cast<float>(x), static_cast<float>(y)};
            point.inverse_depth = rho;
          }
        }
        if (point.inverse_depth <= 0) continue;
        point.variance = kRelativeSigma * kRelativeSigma;
        point.observations = frames_;
        points.push_back(point);
      }
    }
    return points;
  }

  PinholeCamera camera_;
  Truth truth_;
  int frames_;
  int cell_;
  std::vector<FramePtr> fed_;
  bool is_spent_ = false;
};

}  // namespace dsorb
