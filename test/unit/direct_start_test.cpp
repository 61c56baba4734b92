// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/init/direct_start.h"

#include "dsorb/init/registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

using ::testing::ElementsAre;

constexpr int kStartWidth = 64, kStartHeight = 48;
const PinholeCamera kCamera{50, 50, 31.5, 23.5, kStartWidth, kStartHeight};

/// Starts with the fifth image; the second one has no pose, the camera moves to the right.
class FifthImage : public Initializer {
 public:
  [[nodiscard]] InitStep addFrame(FramePtr frame) override {
    const double x = static_cast<double>(start_.frames.size());
    start_.frames.push_back(
        {std::move(frame), SE3(Eigen::Quaterniond::Identity(), {-.1 * x, 0, 0}), {.1, 2}, {}});
    if (start_.frames.size() < 5) return {};
    start_.frames[1].T_cam_ref.reset();
    start_.points = {{0, {10.4F, 20.6F}, 1, 1e-4F, 3},
                     {0, {30, 20}, 1, .08F * .08F, 3},
                     {0, {3, 20}, 1, 1e-4F, 3},   // too near to the edge
                     {0, {40, 20}, 1, .02F, 3},   // too unsure
                     {3, {20, 20}, 1, 1e-4F, 3},  // of a frame that becomes no keyframe
                     {0, {5, 30}, 1, 1e-4F, 3}};  // the newest does not see it
    InitStep step;
    step.status = InitStatus::kInitialized;
    step.result = std::exchange(start_, {});
    return step;
  }
  void reset() override { start_ = {}; }

 private:
  InitializationResult start_;
};

/// Writes down what it is told. A keyframe is the name of its image.
struct Recorder {
  using Frame = std::string;
  using Point = int;

  void posed(const Frame& frame, const PosedFrame& posed) {
    told.push_back("posed " + frame);
    gains.push_back(posed.affine.a);
    T_cam_world[frame] = *posed.T_cam_ref;
  }
  Frame makeFrame(const Frame& frame, const PosedFrame&, const float* image) {
    first_pixels.push_back(image[0]);
    return frame;
  }
  void addKeyframe(const Frame& frame) { told.push_back("add " + frame); }
  int addPoint(const Frame&, int u, int v, const StartDepth& depth) {
    pixels.emplace_back(u, v);
    priors.push_back(depth.prior);
    depths.push_back({depth.inverse_depth, 1e4});
    return static_cast<int>(depths.size()) - 1;
  }
  SE3 pose(const Frame& frame) { return T_cam_world.at(frame); }
  AdjustedDepth depth(int point) { return depths.at(static_cast<std::size_t>(point)); }
  void trace(const Frame& frame) { told.push_back("trace " + frame); }

  std::vector<std::string> told;
  std::map<std::string, SE3> T_cam_world;
  std::vector<std::pair<int, int>> pixels;
  std::vector<AdjustedDepth> depths;
  std::vector<double> gains, priors;
  std::vector<float> first_pixels;
};

class DirectStartTest : public ::testing::Test {
 protected:
  DirectStart<Recorder> make(const DirectStartOptions& options) {
    InitializerOptions initializer;
    initializer.kind = InitializerKind::kRegistered;
    initializer.registered = "fifth image";
    return {initializer, kCamera, options, refusals_};
  }
  /// Gives five images without times, from `a` on. @return the newest keyframe
  std::string start(DirectStart<Recorder>& start) {
    const std::vector<std::uint8_t> image(kStartWidth * kStartHeight, 0);
    std::optional<std::string> newest;
    for (char name = 'a'; name <= 'e'; ++name) {
      newest = start.addFrame(fork_, {name}, ImageView(image.data(), kStartWidth, kStartHeight));
      EXPECT_EQ(newest.has_value(), name == 'e');
    }
    return newest.value_or("");
  }

  RegisteredInitializer registered_{
      "fifth image", [](const auto&, const auto&) { return std::make_unique<FifthImage>(); }};
  int refusals_ = 0;
  Recorder fork_;
};

TEST_F(DirectStartTest, HandsOverInOrderWhatWasGiven) {
  DirectStartOptions options;
  options.keyframes = 2;
  options.fixed_brightness = true;
  DirectStart<Recorder> direct = make(options);
  EXPECT_EQ(start(direct), "e");
  EXPECT_THAT(
      fork_.told,
      ElementsAre("posed a", "add a", "posed c", "trace c", "posed d", "trace d", "posed e"));
  EXPECT_THAT(fork_.gains, ElementsAre(0, 0, 0, 0));
  EXPECT_THAT(fork_.first_pixels, ElementsAre(0, 0, 0, 0));  // not NaN
  using Pixel = std::pair<int, int>;
  EXPECT_THAT(fork_.pixels, ElementsAre(Pixel(10, 21), Pixel(30, 20), Pixel(5, 30)));
  EXPECT_THAT(fork_.priors, ElementsAre(2500, ::testing::DoubleNear(1250, .1), 2500));
}

TEST_F(DirectStartTest, SpreadsKeyframesOverPosedFrames) {
  DirectStart<Recorder> direct = make({});
  start(direct);
  EXPECT_THAT(fork_.told,
              ElementsAre("posed a", "add a", "posed c", "add c", "posed d", "add d", "posed e"));
}

TEST_F(DirectStartTest, RefusesAtMostTwiceInARowUnlessTheAdjustmentBrokeDown) {
  DirectStart<Recorder> direct = make({});
  for (const int expected : {1, 2, 0}) {
    start(direct);
    fork_.T_cam_world["e"] = SE3(Eigen::Quaterniond::Identity(), {0, .4, 0});
    EXPECT_EQ(direct.judge(fork_, 5).has_value(), expected > 0);
    EXPECT_EQ(refusals_, expected);
    EXPECT_EQ(direct.judge(fork_, NAN), std::nullopt);  // of another adjustment
  }
  refusals_ = 2;
  start(direct);
  EXPECT_EQ(direct.judge(fork_, NAN), RefusalReason::kAdjustment);
}

TEST_F(DirectStartTest, PointsThatLeaveTheImageAreNotLost) {
  DirectStart<Recorder> direct = make({});
  start(direct);
  fork_.depths[2] = {};  // at (5, 30)
  EXPECT_EQ(direct.judge(fork_, 5), std::nullopt);
  start(direct);
  fork_.depths[fork_.depths.size() - 3] = {};  // at (30, 20), which the newest keyframe sees
  EXPECT_EQ(direct.judge(fork_, 5), RefusalReason::kDepth);
}

}  // namespace
}  // namespace dsorb
