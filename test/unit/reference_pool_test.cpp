// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/reference_pool.h"

#include "init/waiting_frames.h"
#include "support/plane_scene.h"

#include <gtest/gtest.h>

namespace dsorb::init_orb {
namespace {

/// A plane that a camera passes at constant speed.
class PassedPlane {
 public:
  [[nodiscard]] FramePtr frame(int id) const {
    return scene_.render(SE3(so3Exp({0, 0, 0}), Eigen::Vector3d(0.004 * id, 0, 0)), 0, id);
  }

 private:
  PlaneScene scene_{3};
};

OrbOptions smallPool() {
  OrbOptions options;
  options.reference_interval = 3;
  options.max_frames = 8;
  options.tracks.max_corners = 200;
  return options;
}

/// One life of the pool without attempts.
void feed(ReferencePool& pool, const FramePtr& frame) {
  pool.advance(frame);
  pool.dropLost();
  pool.giveUp(InitReason::kPoorQuality);
  pool.addWhenDue();
}

TEST(ReferencePool, TakesANewReferenceEveryFewFramesAndDropsTheOldest) {
  const PassedPlane plane;
  ReferencePool pool(smallPool(), 256);
  pool.start(plane.frame(0));
  for (int k = 1; k <= 20; ++k) {
    feed(pool, plane.frame(k));
    ASSERT_FALSE(pool.empty());
    for (int i = 0; i < pool.references(); ++i) {
      const ReferenceView view = pool.view(i);
      EXPECT_EQ(view.frames.size(), static_cast<std::size_t>(pool.age(i)));
      EXPECT_EQ(view.tracks.frames(), pool.age(i));
      EXPECT_EQ(view.frames.back()->id().value, k);
      EXPECT_EQ(view.frames.front()->id().value % 3, 0);
      EXPECT_LT(pool.age(i), 9);
      EXPECT_EQ(view.tracks.size(), pool.tracks(i));
    }
  }
  EXPECT_EQ(pool.references(), 2);  // frames 15 and 18; 12 is too old
}

TEST(ReferencePool, EveryReferenceHasItsCornersEverywhere) {
  const PassedPlane plane;
  ReferencePool pool(smallPool(), 256);
  pool.start(plane.frame(0));
  for (int k = 1; k <= 6; ++k) feed(pool, plane.frame(k));
  ASSERT_EQ(pool.references(), 3);
  int fewer = 0;
  for (int i = 0; i < pool.references(); ++i) {
    const CornerTracks tracks = pool.view(i).tracks;
    EXPECT_GE(tracks.size(), fewer);  // a newer reference knows all that an older one does
    fewer = tracks.size();
    for (const auto& frame : tracks.positions) {
      ASSERT_EQ(frame.size(), static_cast<std::size_t>(tracks.size()));
      for (const Eigen::Vector2f& place : frame) EXPECT_TRUE(place.allFinite());
    }
  }
  EXPECT_GT(fewer, 50);
}

TEST(ReferencePool, LosesAllReferencesAtASceneCut) {
  const PassedPlane plane;
  ReferencePool pool(smallPool(), 256);
  pool.start(plane.frame(0));
  for (int k = 1; k <= 4; ++k) feed(pool, plane.frame(k));
  pool.advance(PlaneScene(99).render(SE3(), 0, 5));
  EXPECT_TRUE(pool.dropLost());
  EXPECT_EQ(pool.references(), 0);
}

constexpr double kTurn = 0.2;  // from frame to frame [rad]

/// The camera turns quickly, which moves the image farther than optical flow follows here.
FramePtr turned(const PlaneScene& scene, int id) {
  return scene.render(SE3(so3Exp({0, kTurn * id, 0}), Eigen::Vector3d(0.01 * id, 0, 0)), 0, id);
}

TEST(ReferencePool, FindsFeaturesByDescriptorsWhereFlowLosesTheTracks) {
  const PlaneScene scene(3);
  OrbOptions options = smallPool();
  options.tracks.max_level = 1;  // 20 px at most
  FeatureTracks flow(options.tracks);
  flow.start(*turned(scene, 0));
  flow.advance(*turned(scene, 1));
  ReferencePool pool(options, 256);
  pool.start(turned(scene, 0));
  pool.advance(turned(scene, 1));
  ASSERT_FALSE(pool.dropLost());
  const CornerTracks tracks = pool.view(0).tracks;
  const PinholeCamera& camera = scene.camera();
  int right = 0;
  const int by_descriptors = tracks.size() - flow.size();
  for (auto i = static_cast<std::size_t>(flow.size()); i < tracks.positions[0].size(); ++i) {
    const Eigen::Vector2d pixel = tracks.positions[0][i].cast<double>();
    const Eigen::Vector3d moved = so3Exp({0, kTurn, 0}) * camera.unproject(pixel) +
                                  scene.inverseDepth(pixel) * Eigen::Vector3d(0.01, 0, 0);
    right += (camera.project(moved) - tracks.positions[1][i].cast<double>()).norm() < 1 ? 1 : 0;
  }
  RecordProperty("by_flow", flow.size());
  RecordProperty("by_descriptors", by_descriptors);
  RecordProperty("right", right);
  EXPECT_GT(by_descriptors, 100);
  EXPECT_GT(right, 0.9 * by_descriptors);
}

TEST(ReferencePool, DoesNotTouchDescriptorsWhereFlowFollows) {
  const PassedPlane plane;
  ReferencePool pool(smallPool(), 256);
  pool.start(plane.frame(0));
  for (int k = 1; k <= 4; ++k) feed(pool, plane.frame(k));
  for (int i = 0; i < pool.references(); ++i) {
    // Corners alone: a newer reference has no more than its corners.
    EXPECT_LE(pool.tracks(i), smallPool().tracks.max_corners);
    EXPECT_EQ(pool.view(i).tracks.size(), pool.tracks(i));
  }
}

TEST(ReferencePool, RemembersWhatAnAttemptSaw) {
  const PassedPlane plane;
  ReferencePool pool(smallPool(), 256);
  pool.start(plane.frame(0));
  AttemptSummary evidence;
  evidence.rotation_residual = 3;
  pool.remember(0, evidence);
  feed(pool, plane.frame(1));
  EXPECT_EQ(pool.view(0).last.rotation_residual, 3);
  pool.start(plane.frame(2));
  EXPECT_EQ(pool.view(0).last.rotation_residual, 0);
}

TEST(ReferencePool, TheOldestAndTheOneThatHasWaitedLongestAreTriedFirst) {
  const PassedPlane plane;
  OrbOptions options = smallPool();
  options.reference_interval = 1;
  ReferencePool pool(options, 256);
  pool.start(plane.frame(0));
  for (int k = 1; k <= 3; ++k) feed(pool, plane.frame(k));
  ASSERT_EQ(pool.references(), 4);
  EXPECT_EQ(pool.turns(), (std::vector<int>{0, 1, 2, 3}));
  AttemptSummary tried;
  tried.tried = true;
  pool.remember(0, tried);
  pool.remember(1, tried);
  pool.remember(2, AttemptSummary());
  EXPECT_EQ(pool.turns(), (std::vector<int>{0, 2, 3, 1}));
}

TEST(ReferencePool, ForgetsFramesBetweenBeyondTheBudget) {
  const PassedPlane plane;
  OrbOptions options = smallPool();
  options.max_frames = 30;
  ReferencePool all(options, 256);
  ReferencePool few(options, 5);
  all.start(plane.frame(0));
  few.start(plane.frame(0));
  for (int k = 1; k <= 16; ++k) {
    feed(all, plane.frame(k));
    feed(few, plane.frame(k));
    EXPECT_EQ(few.age(0), k + 1);
  }
  const ReferenceView whole = all.view(0);
  const ReferenceView thin = few.view(0);
  ASSERT_EQ(whole.frames.size(), 17U);
  ASSERT_EQ(thin.frames.size(), waitingFrames(*plane.frame(0), 5));
  EXPECT_EQ(thin.frames.front()->id().value, 0);
  EXPECT_EQ(thin.frames.back()->id().value, 16);
  for (std::size_t k = 0; k < thin.frames.size(); ++k) {
    const int id = thin.frames[k]->id().value;
    EXPECT_EQ(thin.tracks.positions[k], whole.tracks.positions[static_cast<std::size_t>(id)]);
    const int next = k + 1 < thin.frames.size() ? thin.frames[k + 1]->id().value : id;
    EXPECT_LE(next - id, 8);  // of 16 frames in three steps; measured 7
  }
}

TEST(ReferencePool, GivesUpByFramesGivenNotByThoseKept) {
  const PassedPlane plane;
  ReferencePool pool(smallPool(), 1);
  pool.start(plane.frame(0));
  for (int k = 1; k <= 20; ++k) feed(pool, plane.frame(k));
  for (int i = 0; i < pool.references(); ++i) EXPECT_LT(pool.age(i), 9);
}

}  // namespace
}  // namespace dsorb::init_orb
