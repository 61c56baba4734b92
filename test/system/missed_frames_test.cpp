// SPDX-License-Identifier: BSD-3-Clause
// Frames without a pose while the map stands: black, torn, too noisy.
#include "dsorb/odometry/odometry.h"

#include "base/random.h"
#include "support/matchers.h"
#include "support/odometry_run.h"

#include <gtest/gtest.h>

#include <functional>
#include <vector>

namespace dsorb {
namespace {

/// Grey level of a changed image from pixel and grey level.
using Change = std::function<float(int x, int y, float grey)>;

FramePtr changed(const Frame& frame, const Change& change) {
  const PyramidLevel& image = frame.level(0);
  std::vector<float> pixels;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) pixels.push_back(change(x, y, image.intensity(x, y)));
  }
  return Frame::create({pixels.data(), image.width(), image.height()},
                       {frame.id(), frame.timestamp(), frame.exposure()});
}

class MissedFrames : public TruthStarted {
 protected:
  /// Feeds changed frames [begin, end).
  void runChanged(int begin, int end, const Change& change) {
    for (int i = begin; i < end; ++i) odometry->process(changed(*frame(i), change));
  }
  void runBlack(int begin, int end) {
    runChanged(begin, end, [](int, int, float) { return 0.0F; });
  }
  static const FramePtr& frame(int index) {
    return trackedRoom().frames()[static_cast<std::size_t>(index)];
  }
  void expectTracked() const {
    ASSERT_EQ(last().state, OdometryState::kTracked);
    EXPECT_THAT(
        *last().T_world_cam,
        Se3Near(
            truePose(trackedRoom(), recorder, last()), kTrackedRotationDeg, kTrackedTranslation));
  }
};

TEST_F(MissedFrames, TheMapStandsWhileAFewAreBlack) {
  start(trackedRoom());
  run(0, 10);
  runBlack(10, 13);
  EXPECT_EQ(last().state, OdometryState::kMissed);
  EXPECT_FALSE(last().T_world_cam);
  EXPECT_EQ(last().segment, 0);
  EXPECT_EQ(recorder.events.back(), "missed 0");
  run(13, 14);
  expectTracked();
  run(14, 30);
  expectTracked();
  const OdometryReport report = odometry->finish();
  EXPECT_EQ(report.frames_missed, 3);
  EXPECT_EQ(report.segments, 1);
}

TEST_F(MissedFrames, OneMoreLosesIt) {
  start(trackedRoom());
  run(0, 10);
  runBlack(10, 14);
  EXPECT_EQ(last().state, OdometryState::kLost);
  EXPECT_EQ(recorder.events.back(), "lost at 13 in 0");
  EXPECT_EQ(odometry->finish().frames_missed, 3);
}

TEST_F(MissedFrames, NoneWhereTheOptionSaysSo) {
  OdometryOptions options;
  options.max_missed = 0;
  start(trackedRoom(), options);
  run(0, 10);
  runBlack(10, 11);
  EXPECT_EQ(last().state, OdometryState::kLost);
}

TEST_F(MissedFrames, EachPoseBeginsTheCountAnew) {
  start(trackedRoom());
  run(0, 10);
  for (int i = 10; i < 26; i += 4) {
    runBlack(i, i + 3);
    run(i + 3, i + 4);
    expectTracked();
  }
}

/// Two thirds of the image are of another moment: before, such a frame got a pose that was degrees
/// off, became a keyframe and bent the map.
TEST_F(MissedFrames, ATornImageGetsNoPose) {
  start(trackedRoom());
  run(0, 12);
  const PyramidLevel& other = frame(29)->level(0);
  runChanged(
      12, 14, [&](int x, int y, float grey) { return y < 80 ? grey : other.intensity(x, y); });
  EXPECT_EQ(recorder.estimates[12].state, OdometryState::kMissed);
  EXPECT_EQ(last().state, OdometryState::kMissed);
  run(14, 30);
  expectTracked();
}

/// The first images that are worse are kept out of the map; those that stay so are what there is.
TEST_F(MissedFrames, AChangeThatStaysReachesTheMap) {
  start(trackedRoom());
  run(0, 10);
  Random random(1);
  runChanged(10, 25, [&](int, int, float grey) {
    return grey + 16 * static_cast<float>(random.gaussian());
  });
  EXPECT_EQ(last().state, OdometryState::kTracked);
  for (int i = 10; i < 13; ++i) EXPECT_EQ(recorder.ids.count(i), 0U) << i;
  EXPECT_GT(*recorder.ids.rbegin(), 12);
  EXPECT_EQ(odometry->finish().frames_missed, 0);
}

/// A recognizer that knows some frames, each at one metre to the right of the one before.
Recognizer recognizerOf(int begin, int end) {
  return [=](const Frame& frame) -> std::optional<RecognizedPlace> {
    const int id = frame.id().value;
    if (id < begin || id >= end) return std::nullopt;
    RecognizedPlace place;
    place.T_world_cam = SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(id, 0, 0));
    place.depths.push_back({100, 100, 1, 0.1F});
    place.keyframe = FrameId{0};
    place.T_cam_keyframe = place.T_world_cam.inverse();
    return place;
  };
}

TEST_F(MissedFrames, ThoseThatAreRecognizedHaveAPose) {
  start(trackedRoom());
  run(0, 10);
  odometry->setRecognizer(recognizerOf(8, 12));
  run(10, 11);
  expectTracked();  // nobody is asked about frames that the map shows
  runBlack(11, 13);
  const FrameEstimate& recognized = recorder.estimates[11];
  EXPECT_EQ(recognized.state, OdometryState::kTracked);
  ASSERT_TRUE(recognized.T_world_cam);
  EXPECT_EQ(recognized.T_world_cam->translation().x(), 11);
  EXPECT_EQ(last().state, OdometryState::kMissed);
  run(13, 14);
  expectTracked();  // the map that stood goes on
  EXPECT_EQ(odometry->finish().frames_missed, 1);
}

class RepeatedImages : public TruthStarted {};

TEST_F(RepeatedImages, ChangeNothing) {
  start(trackedRoom());
  run(0, 30);
  const Recorder once = recorder;
  recorder = Recorder();
  start(trackedRoom());
  for (const FramePtr& frame : trackedRoom().frames()) {
    odometry->process(frame);
    const PyramidLevel& image = frame->level(0);
    odometry->process(Frame::create(
        {image.data(), image.width(), image.height()},
        {FrameId{1000 + frame->id().value}, frame->timestamp() + 1e-3, frame->exposure()}));
  }
  EXPECT_EQ(recorder.ids, once.ids);
  ASSERT_EQ(recorder.estimates.size(), 2 * once.estimates.size());
  for (std::size_t i = 0; i < once.estimates.size(); ++i) {
    const FrameEstimate& copy = recorder.estimates[2 * i + 1];
    EXPECT_FALSE(copy.is_keyframe);
    EXPECT_FALSE(recorder.estimates[2 * i].repeats);
    EXPECT_EQ(copy.repeats, recorder.estimates[2 * i].frame->id());
    ASSERT_EQ(copy.T_world_cam.has_value(), once.estimates[i].T_world_cam.has_value());
    if (!copy.T_world_cam) continue;
    EXPECT_EQ(copy.state, OdometryState::kTracked);
    EXPECT_EQ(copy.T_world_cam->matrix(), once.estimates[i].T_world_cam->matrix());
    EXPECT_EQ(recorder.estimates[2 * i].T_world_cam->matrix(), copy.T_world_cam->matrix());
  }
}

}  // namespace
}  // namespace dsorb
