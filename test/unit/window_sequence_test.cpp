// SPDX-License-Identifier: BSD-3-Clause
// All mapping steps of a keyframe in their order, over a rendered sequence; the tracker is replaced
// by the true motion since the last keyframe with noise.
#include "image/pixel_selector.h"
#include "support/matchers.h"
#include "support/window_scene.h"
#include "window/keyframe_policy.h"
#include "window/marginalization.h"
#include "window/point_activation.h"
#include "window/window_optimizer.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace dsorb::window {
namespace {

struct RunResult {
  int keyframes = 0;
  int least_points = 1000000;
  int retired_points = 0;
  std::size_t most_keyframes = 0;
  double worst_rotation_deg = 0;  // of a keyframe when it leaves or at the end
  double worst_translation = 0;   // after the fit of one scale, relative to the way
  double worst_rms = 0;
  bool finite = true;
};

WindowOptions referenceOptions() {
  WindowOptions options;
  options.published = true;
  options.optimizer.optimize_intrinsics = true;
  return options;
}

/// Estimated and true camera centres and orientations, world: first keyframe.
struct Trajectory {
  std::vector<SE3> estimated;
  std::vector<SE3> truth;

  void add(const Keyframe& keyframe, const synthetic::SyntheticSequence& sequence) {
    estimated.push_back(keyframe.T_cam_world().inverse());
    truth.push_back(sequence.pose(0).inverse() * sequence.pose(keyframe.frame->id().value));
  }
  void judge(RunResult& result) const {
    double numerator = 0, denominator = 0, way = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      numerator += truth[i].translation().dot(estimated[i].translation());
      denominator += estimated[i].translation().squaredNorm();
      way = std::max(way, truth[i].translation().norm());
    }
    const double scale = numerator / denominator;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      result.worst_rotation_deg =
          std::max(result.worst_rotation_deg, rotationErrorDeg(estimated[i], truth[i]));
      const double error =
          (scale * estimated[i].translation() - truth[i].translation()).norm() / way;
      result.worst_translation = std::max(result.worst_translation, error);
    }
  }
};

class MappingRun {
 public:
  MappingRun(const WindowOptions& options, int desired_points)
      : options_(options),
        sequence_([] {
          synthetic::SequenceOptions o;
          o.width = 320;
          o.height = 240;
          o.length = 80;
          return o;
        }()),
        window_(sequence_.camera()),
        selector_(320, 240, {}),
        optimizer_(options) {
    options_.desired_points = desired_points;
    depth_options_.candidates_per_keyframe = desired_points;
  }

  RunResult run(int frames) {
    const synthetic::SyntheticFrame first = sequence_.frame(0);
    const FramePtr frame = sequence_.framePtr(first, 0);
    std::vector<MapPoint> seeds =
        window_scene::truePoints(frame->level(0), first.inverse_depth, 10, 1e-4F);
    double mean = 0;
    for (const MapPoint& seed : seeds) {
      mean += static_cast<double>(seed.inverse_depth) / static_cast<double>(seeds.size());
    }
    unit_ = mean;
    for (MapPoint& seed : seeds) seed.inverse_depth /= static_cast<float>(mean);
    addKeyframe(window_, frame, SE3(), {}, options_);
    odometry::seedPoints(window_, 0, seeds, options_);
    for (int index = 1; index < frames; ++index) process(index);
    for (const Keyframe& keyframe : window_.keyframes) trajectory_.add(keyframe, sequence_);
    trajectory_.judge(result_);
    return result_;
  }

 private:
  static constexpr int kInterval = 4;  // frames from keyframe to keyframe

  void process(int index) {
    const FramePtr frame = sequence_.framePtr(index);
    const Keyframe& last = window_.keyframes.back();
    SE3 T_frame_last = sequence_.pose(index).inverse() * sequence_.pose(last.frame->id().value);
    T_frame_last.setTranslation(T_frame_last.translation() * unit_);
    Vector6d noise;
    for (int i = 0; i < 6; ++i) noise[i] = 5e-4 * random_.gaussian();
    const SE3 T_cam_world = SE3::exp(noise) * T_frame_last * last.T_cam_world();
    refineCandidates(window_, {frame, T_cam_world, {}}, depth_options_);
    if (index % kInterval == 0) addAndMap(frame, T_cam_world);
  }

  void addAndMap(const FramePtr& frame, const SE3& T_cam_world) {
    flagLeaving(window_, options_);
    addKeyframe(window_, frame, T_cam_world, {}, options_);
    activateCandidates(window_, options_, depth_options_);
    result_.most_keyframes = std::max(result_.most_keyframes, window_.keyframes.size());
    const OptimizationReport report = optimizer_.optimize(window_);
    result_.finite = result_.finite && report.finite;
    result_.worst_rms = std::max(result_.worst_rms, report.rms);
    EXPECT_GT(depthSamples(window_, options_).size(), 50U);
    retirePoints(window_, options_);
    addCandidates(window_.keyframes.back(),
                  selector_.select(*frame, depth_options_.candidates_per_keyframe));
    for (const Keyframe& gone : marginalizeFlagged(window_, options_)) {
      trajectory_.add(gone, sequence_);
      result_.retired_points += static_cast<int>(gone.marginalized.size());
    }
    ++result_.keyframes;
    result_.least_points = std::min(result_.least_points, static_cast<int>(window_.numPoints()));
  }

  WindowOptions options_;
  DepthOptions depth_options_;
  synthetic::SyntheticSequence sequence_;
  Window window_;
  PixelSelector selector_;
  WindowOptimizer optimizer_;
  Trajectory trajectory_;
  RunResult result_;
  Random random_{17};
  double unit_ = 1;
};

void report(const RunResult& result) {
  testing::Test::RecordProperty("rotation", std::to_string(result.worst_rotation_deg));
  testing::Test::RecordProperty("translation", std::to_string(result.worst_translation));
  testing::Test::RecordProperty("points", std::to_string(result.least_points));
  testing::Test::RecordProperty("retired", std::to_string(result.retired_points));
  testing::Test::RecordProperty("rms", std::to_string(result.worst_rms));
}

TEST(WindowSequenceTest, ARunOfKeyframesStaysNearTheTruth) {
  const RunResult result = MappingRun(WindowOptions(), 800).run(80);
  report(result);
  EXPECT_TRUE(result.finite);
  EXPECT_EQ(result.keyframes, 19);
  EXPECT_LE(result.most_keyframes, 8U);
  EXPECT_GT(result.least_points, 300);         // measured 487
  EXPECT_GT(result.retired_points, 1000);      // measured 2044
  EXPECT_LT(result.worst_rotation_deg, 0.1);   // measured 0.041
  EXPECT_LT(result.worst_translation, 0.005);  // measured 0.0022
}

TEST(WindowSequenceTest, SoDoesTheReferenceMode) {
  const RunResult result = MappingRun(referenceOptions(), 800).run(80);
  report(result);
  EXPECT_TRUE(result.finite);
  EXPECT_LT(result.worst_rotation_deg, 0.1);   // measured 0.039
  EXPECT_LT(result.worst_translation, 0.005);  // measured 0.0022
}

}  // namespace
}  // namespace dsorb::window
