// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/mapper.h"

#include "base/median.h"
#include "support/matchers.h"
#include "support/odometry_run.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <optional>
#include <stdexcept>
#include <vector>

namespace dsorb::odometry {
namespace {

// Poses of keyframes in this file: measured at most 0.0252 deg and 0.00047 units, with GCC and
// clang (which draws otherwise) and 700 to 2000 candidates a keyframe; margin x1.5.
constexpr double kMaxRotationDeg = 0.038;
constexpr double kMaxTranslation = 0.00075;
constexpr int kSegment = 7;

/// A room of eight frames, of which the first four are the initialization by truth.
class MapperTest : public ::testing::Test {
 protected:
  static const World& room() {
    static const World world(synthetic::SequenceKind::kRoom, 8);
    return world;
  }
  static const InitializationResult& result() {
    static const InitializationResult initialization = room().initialization();
    return initialization;
  }
  /// In the origin and the unit of the initialization.
  [[nodiscard]] static SE3 T_cam_world(int i) { return room().T_cam_world(result(), i); }
  /// A frame with its true pose relative to a keyframe.
  [[nodiscard]] static MappingJob job(int i, int keyframe, bool becomes_keyframe) {
    MappingJob job;
    job.frame = room().frames()[static_cast<std::size_t>(i)];
    job.pose.good = true;
    job.pose.keyframe = FrameId{keyframe};
    job.pose.T_cam_keyframe = T_cam_world(i) * T_cam_world(keyframe).inverse();
    job.pose.T_cam_world = T_cam_world(i);
    job.becomes_keyframe = becomes_keyframe;
    return job;
  }
  [[nodiscard]] static std::vector<int> idsOf(const std::vector<KeyframeSnapshot>& keyframes) {
    std::vector<int> ids;
    for (const KeyframeSnapshot& keyframe : keyframes) ids.push_back(keyframe.id.value);
    return ids;
  }
  static void expectNearTruth(const TrackingTarget& target, int i) {
    EXPECT_EQ(target.reference.frame->id(), FrameId{i});
    EXPECT_THAT(target.keyframe.T_cam_world,
                Se3Near(T_cam_world(i), kMaxRotationDeg, kMaxTranslation));
  }
  [[nodiscard]] Mapper mapper() const { return Mapper(room().camera(), options_); }

  OdometryOptions options_;
};

TEST_F(MapperTest, SeedMakesAMapWhoseNewestKeyframeIsTheTarget) {
  Mapper m = mapper();
  const MapUpdate update = m.seed(result(), kSegment);
  ASSERT_TRUE(update.finite);
  EXPECT_EQ(update.new_keyframes, kInitialFrames);
  EXPECT_EQ(idsOf(update.window), (std::vector<int>{0, 1, 2, 3}));
  EXPECT_TRUE(update.retired.empty());
  expectNearTruth(update.target, 3);
  EXPECT_GT(update.target.reference.at(0).size(), 3500U);  // measured 7054
}

TEST_F(MapperTest, AMapThatNoOtherFrameSeesIsNone) {
  InitializationResult unseen = result();
  const SE3 behind(Eigen::Quaterniond(0, 0, 1, 0), Eigen::Vector3d::Zero());
  for (std::size_t i = 1; i < unseen.frames.size(); ++i) {
    unseen.frames[i].T_cam_ref = behind * *unseen.frames[i].T_cam_ref;
  }
  Mapper m = mapper();
  EXPECT_TRUE(m.seed(result(), kSegment).finite);
  EXPECT_FALSE(m.seed(unseen, kSegment).finite);
}

TEST_F(MapperTest, SnapshotsTellSegmentPoseAndDepthsNearTheTruth) {
  Mapper m = mapper();
  const MapUpdate update = m.seed(result(), kSegment);
  for (const KeyframeSnapshot& keyframe : update.window) {
    EXPECT_EQ(keyframe.segment, kSegment);
    EXPECT_THAT(keyframe.T_world_cam.inverse(),
                Se3Near(T_cam_world(keyframe.id.value), kMaxRotationDeg, kMaxTranslation));
  }
  const std::vector<float> truth = room().inverseDepth(0);
  const double unit = room().unitOf(result());
  std::vector<double> errors;
  std::vector<double> deviations;  // standard, as the map tells them
  for (const MapPoint& point : update.window[0].points) {
    EXPECT_GT(point.variance, 0);
    const auto at = static_cast<std::size_t>(point.pixel.y()) * 320U +
                    static_cast<std::size_t>(point.pixel.x());
    errors.push_back(std::abs(
        static_cast<double>(point.inverse_depth) / (unit * static_cast<double>(truth[at])) - 1));
    deviations.push_back(static_cast<double>(std::sqrt(point.variance) / point.inverse_depth));
  }
  EXPECT_GT(errors.size(), 900U);          // measured 1831
  EXPECT_LT(medianOf(errors), 0.04);       // measured 0.024
  EXPECT_LT(medianOf(deviations), 0.055);  // measured 0.029
}

TEST_F(MapperTest, OnlyAKeyframeChangesTheWindow) {
  Mapper m = mapper();
  (void)m.seed(result(), kSegment);
  EXPECT_EQ(m.map(job(4, 3, false)), nullptr);
  const std::unique_ptr<MapUpdate> update = m.map(job(5, 3, true));
  ASSERT_NE(update, nullptr);
  EXPECT_EQ(update->new_keyframes, 1);
  EXPECT_EQ(idsOf(update->window), (std::vector<int>{0, 1, 2, 3, 5}));
  expectNearTruth(update->target, 5);
  EXPECT_EQ(update->target.T_cam_previous.matrix(), job(5, 3, true).pose.T_cam_keyframe.matrix());
}

TEST_F(MapperTest, AFrameHangsOnItsKeyframeWhileThatIsInTheWindow) {
  const SE3 nonsense(Eigen::Quaterniond::Identity(), {9, 9, 9});
  MappingJob hangs = job(4, 3, true);
  hangs.pose.T_cam_world = nonsense;
  MappingJob alone = job(4, 3, true);
  alone.pose.keyframe = FrameId{99};
  alone.pose.T_cam_keyframe = nonsense;
  for (const MappingJob& job : {hangs, alone}) {
    Mapper m = mapper();
    (void)m.seed(result(), kSegment);
    const std::unique_ptr<MapUpdate> update = m.map(job);
    ASSERT_TRUE(update->finite);
    expectNearTruth(update->target, 4);
  }
}

TEST_F(MapperTest, EveryKeyframeRetiresOrStays) {
  options_.window.max_keyframes = 5;
  Mapper m = mapper();
  const MapUpdate seeded = m.seed(result(), kSegment);
  std::vector<int> told = idsOf(seeded.retired);
  for (int i = 4; i < 8; ++i) {
    const std::unique_ptr<MapUpdate> update = m.map(job(i, i - 1, true));
    ASSERT_TRUE(update->finite);
    EXPECT_LE(update->window.size(), 5U);
    for (const KeyframeSnapshot& keyframe : update->retired) {
      EXPECT_EQ(keyframe.segment, kSegment);
      told.push_back(keyframe.id.value);
    }
  }
  EXPECT_GE(told.size(), 3U) << "left before the end";
  for (const int id : idsOf(m.clear())) told.push_back(id);
  EXPECT_THAT(told, ::testing::UnorderedElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
}

TEST_F(MapperTest, AfterClearASeedGivesTheSameBits) {
  Mapper m = mapper();
  EXPECT_TRUE(m.clear().empty()) << "there is no map yet";
  const MapUpdate first = m.seed(result(), kSegment);
  (void)m.map(job(4, 3, true));
  EXPECT_EQ(idsOf(m.clear()), (std::vector<int>{0, 1, 2, 3, 4}));
  EXPECT_TRUE(m.clear().empty());
  const MapUpdate second = m.seed(result(), kSegment + 1);
  EXPECT_EQ(first.window[0].points.at(0).variance, second.window[0].points.at(0).variance);
  EXPECT_EQ(first.target.keyframe.T_cam_world.matrix(),
            second.target.keyframe.T_cam_world.matrix());
  EXPECT_EQ(first.target.reference.at(0).inverse_depth,
            second.target.reference.at(0).inverse_depth);
  EXPECT_EQ(second.window.front().segment, kSegment + 1);
}

/// The mapper behind its queue, without and with a thread of its own.
class AsyncMapperTest : public MapperTest {
 protected:
  std::unique_ptr<AsyncMapper> make(bool pipelined) {
    options_.pipelined = pipelined;
    return std::make_unique<AsyncMapper>(room().camera(), options_, arena_);
  }

 private:
  TaskArena arena_{1};
};

TEST_F(AsyncMapperTest, AThreadOfItsOwnGivesTheSameBits) {
  std::vector<SE3> poses;
  for (const bool pipelined : {false, true}) {
    const std::unique_ptr<AsyncMapper> m = make(pipelined);
    const MappingResult seeded = m->seed(result(), kSegment);
    EXPECT_GT(seeded.seconds, 0);
    m->submit(job(4, 3, false));
    m->submit(job(5, 3, true));
    if (pipelined) m->wait();
    const std::optional<MappingResult> frame = m->take();
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->update, nullptr);
    const std::optional<MappingResult> keyframe = m->take();
    ASSERT_TRUE(keyframe && keyframe->update);
    EXPECT_FALSE(m->take());
    poses.push_back(keyframe->update->target.keyframe.T_cam_world);
  }
  EXPECT_EQ(poses[0].matrix(), poses[1].matrix());
}

TEST_F(AsyncMapperTest, AKeyframeIsDueUntilItsResultIsTaken) {
  for (const bool pipelined : {false, true}) {
    const std::unique_ptr<AsyncMapper> m = make(pipelined);
    (void)m->seed(result(), kSegment);
    m->submit(job(4, 3, false));
    EXPECT_FALSE(m->keyframeIsDue());
    m->submit(job(5, 3, true));
    EXPECT_TRUE(m->keyframeIsDue());
    m->wait();
    EXPECT_TRUE(m->busy()) << "results wait to be taken";
    (void)m->take();
    EXPECT_TRUE(m->keyframeIsDue()) << "this was the other frame";
    (void)m->take();
    EXPECT_FALSE(m->keyframeIsDue());
    EXPECT_FALSE(m->busy());
  }
}

TEST_F(AsyncMapperTest, ClearDropsWorkAndResults) {
  for (const bool pipelined : {false, true}) {
    const std::unique_ptr<AsyncMapper> m = make(pipelined);
    (void)m->seed(result(), kSegment);
    for (int i = 4; i < 7; ++i) m->submit(job(i, i - 1, true));
    EXPECT_GE(m->clear().size(), 4U);
    EXPECT_FALSE(m->busy());
    EXPECT_FALSE(m->keyframeIsDue());
    EXPECT_FALSE(m->take());
    const MappingResult again = m->seed(result(), kSegment);
    EXPECT_EQ(idsOf(again.update->window), (std::vector<int>{0, 1, 2, 3}));
  }
}

TEST_F(AsyncMapperTest, AFailureIsTakenBehindTheResultsBeforeItAndANewMapBegins) {
  for (const bool pipelined : {false, true}) {
    const std::unique_ptr<AsyncMapper> m = make(pipelined);
    EXPECT_NO_THROW(m->submit(job(5, 3, true))) << "there is no map yet: mapping throws";
    m->wait();
    EXPECT_THROW((void)m->take(), std::logic_error);
    EXPECT_FALSE(m->busy());
    EXPECT_TRUE(m->clear().empty());
    EXPECT_FALSE(m->keyframeIsDue()) << "else there would never be a keyframe again";
    (void)m->seed(result(), kSegment);
    m->submit(job(4, 3, true));
    m->wait();
    const std::optional<MappingResult> keyframe = m->take();
    EXPECT_TRUE(keyframe && keyframe->update && keyframe->update->finite);
  }
}

}  // namespace
}  // namespace dsorb::odometry
