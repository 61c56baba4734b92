// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/place/place.h"

#include "dsorb/error.h"

#include "base/random.h"
#include "place/alignment.h"
#include "place/binary_index.h"
#include "place/binary_matches.h"
#include "place/joining.h"
#include "place/keyframe_store.h"
#include "place/loops.h"
#include "place/map_file.h"
#include "place/recent_views.h"
#include "place/recognition.h"
#include "support/temporary_folder.h"
#include "synthetic/places.h"
#include "synthetic/sequence.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

using place::BinaryDescriptor;

Similarity someSimilarity() {
  return {SE3(so3Exp({0.2, -0.5, 0.3}), Eigen::Vector3d(1, -2, 0.5)), 1.7};
}

TEST(SimilarityTest, InverseAndProductAreThoseOfItsMatrix) {
  const Similarity a = someSimilarity();
  const Similarity b{SE3(so3Exp({-0.1, 0.4, 0.9}), Eigen::Vector3d(0.3, 0.2, -1)), 0.6};
  const Eigen::Vector3d p(0.4, -0.7, 2);
  EXPECT_LT((a.inverse() * (a * p) - p).norm(), 1e-12);
  EXPECT_LT(((a * b) * p - a * (b * p)).norm(), 1e-12);
}

TEST(SimilarityTest, AdjointCarriesIncrementsOver) {
  const Similarity a = someSimilarity();
  Vector7d xi;
  xi << 1, -2, 3, 2, 1, -1, 2;
  xi *= 1e-6;
  const Eigen::Vector3d p(0.4, -0.7, 2);
  const Eigen::Vector3d moved = (a * Similarity::increment(xi) * a.inverse()) * p;
  const Eigen::Vector3d expected = Similarity::increment(Vector7d(a.adjoint() * xi)) * p;
  EXPECT_LT((moved - expected).norm(), 1e-10);
}

BinaryDescriptor randomDescriptor(Random& random) {
  return {random.next(), random.next(), random.next(), random.next()};
}

/// The same corner seen again: one bit in eight differs.
BinaryDescriptor seenAgain(BinaryDescriptor descriptor, Random& random) {
  for (int flip = 0; flip < 32; ++flip) {
    const std::uint32_t bit = random.below(256);
    descriptor[bit / 64] ^= std::uint64_t{1} << (bit % 64);
  }
  return descriptor;
}

TEST(BinaryIndexTest, FindsAnImageSeenAgainAmongMany) {
  Random random(1);
  place::BinaryIndex index;
  std::vector<std::vector<BinaryDescriptor>> images(500);
  for (auto& image : images) {
    for (int i = 0; i < 300; ++i) image.push_back(randomDescriptor(random));
    index.add(image);
  }
  for (const std::size_t wanted : {3U, 250U, 499U}) {
    std::vector<BinaryDescriptor> query;
    for (std::size_t i = 0; i < 300; ++i) {  // a third of the corners
      query.push_back(i % 3 == 0 ? seenAgain(images[wanted][i], random) : randomDescriptor(random));
    }
    const auto found = index.query(query, 3, [](std::size_t) { return true; });
    ASSERT_FALSE(found.empty());
    EXPECT_EQ(found.front().image, wanted);
    const auto others = index.query(query, 3, [&](std::size_t image) { return image != wanted; });
    for (const auto& other : others) EXPECT_NE(other.image, wanted);
  }
}

/// Points before cameras of two maps, b being map a in another unit.
struct TwoMaps {
  explicit TwoMaps(double noise) {
    Random random(2);
    const PinholeCamera camera{300, 300, 160, 120, 320, 240};
    for (int i = 0; i < 200; ++i) {
      place::Sight sight;
      sight.backward = i % 2 == 1;
      const Eigen::Vector3d in_a(
          random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(3, 8));
      sight.T_cam_map = SE3(so3Exp({0, random.uniform(-0.1, 0.1), 0}),
                            Eigen::Vector3d(random.uniform(-0.5, 0.5), 0, 0));
      const Eigen::Vector3d in_b = S_a_b.inverse() * in_a;
      sight.point = sight.backward ? in_a : in_b;
      sight.uncertainty.setZero();
      if (sight.backward)
        sight.T_cam_map = S_a_b.inverse().moved(sight.T_cam_map.inverse()).inverse();
      const Eigen::Vector3d seen = sight.T_cam_map * (sight.backward ? in_b : in_a);
      sight.camera = camera;
      sight.pixel =
          camera.project(seen) + noise * Eigen::Vector2d(random.gaussian(), random.gaussian());
      sight.sigma = std::max(noise, 0.1);
      if (i % 10 == 0) sight.pixel += Eigen::Vector2d(40, -30);  // wrong
      sights.push_back(sight);
    }
  }
  Similarity S_a_b = someSimilarity();
  std::vector<place::Sight> sights;
};

TEST(AlignmentTest, FindsTheSimilarityOfTwoMapsInSpiteOfWrongMatches) {
  const TwoMaps maps(0);
  Vector7d off = Vector7d::Constant(0.02);
  const auto found = place::align(maps.sights, Similarity::increment(off) * maps.S_a_b, true);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->S_a_b.scale, maps.S_a_b.scale, 1e-3);
  EXPECT_EQ(found->inliers, 180U);
}

TEST(AlignmentTest, ItsErrorIsOfTheSizeOfItsCovariance) {
  const TwoMaps maps(0.5);
  const auto found = place::align(maps.sights, maps.S_a_b, true);
  ASSERT_TRUE(found);
  const double error = std::log(found->S_a_b.scale / maps.S_a_b.scale);
  EXPECT_LT(std::abs(error), 4 * std::sqrt(found->covariance(6, 6)));
  EXPECT_LT(std::sqrt(found->covariance(6, 6)), 0.01);
}

/// Enters what a camera sees. @param told the pose that is believed
void enterView(place::KeyframeStore& store,
               place::BinaryIndex& index,
               int segment,
               const synthetic::Scene& room,
               const SE3& pose,
               const SE3& told) {
  const PinholeCamera camera{200, 200, 159.5, 119.5, 320, 240};
  const synthetic::View view = synthetic::render(room, camera, pose);
  FrameInfo info;
  info.id = FrameId{static_cast<int>(store.size())};
  const FramePtr frame = Frame::create(ImageView(view.intensity.data(), 320, 240), info);
  KeyframeSnapshot keyframe;
  keyframe.id = info.id;
  keyframe.segment = segment;
  keyframe.camera = camera;
  keyframe.T_world_cam = told;
  store.add(keyframe, place::describeView(*frame), segment);
  index.add(store[store.size() - 1].view.descriptors);
}

/// Keyframes of a rendered room by the truth. @param first frame of its path
void enterRoom(place::KeyframeStore& store,
               place::BinaryIndex& index,
               int segment,
               const synthetic::Scene& room,
               double first,
               double unit) {
  for (int k = 0; k < 6; ++k) {
    const SE3 pose = synthetic::roomPose(first + 5 * k, 1);
    enterView(
        store, index, segment, room, pose, {pose.unitQuaternion(), pose.translation() * unit});
  }
  store.triangulate(segment);
}

std::vector<std::size_t> allOf(const place::KeyframeStore& store) {
  std::vector<std::size_t> all;
  for (std::size_t i = 0; i < store.size(); ++i) all.push_back(i);
  return all;
}

TEST(JoiningTest, SegmentsOfOneRoomBecomeOneInTheRightUnit) {
  place::KeyframeStore store;
  place::BinaryIndex index;
  const synthetic::Scene room = synthetic::makeRoom(5);
  enterRoom(store, index, 0, room, 0, 1);
  enterRoom(store, index, 1, room, 12, 0.4);
  const auto links =
      place::findLinks(store, index, allOf(store), [&](std::size_t a, std::size_t b) {
        return store[a].segment != store[b].segment;
      });
  const std::vector<place::Join> joins = place::joinsOf(store, links);
  ASSERT_EQ(joins.size(), 1U);
  EXPECT_NEAR(joins.front().S_into_segment.scale, 2.5, 0.02 * 2.5);
  EXPECT_LT(joins.front().S_into_segment.motion.log().tail<3>().norm(), 0.01);
  EXPECT_LT(joins.front().wrong_probability, 1e-4);
}

TEST(JoiningTest, RoomsOfTheSameTexturesStayTwo) {
  place::KeyframeStore store;
  place::BinaryIndex index;
  const synthetic::Scene first = synthetic::makeRoom(5);
  for (int i = 0; i < 8; ++i) {
    synthetic::Scene room = synthetic::makeRoom(static_cast<std::uint64_t>(20 + i));
    for (std::size_t t = 0; t < room.textures.size(); ++t) {
      room.textures[t] = first.textures[(7 * t + static_cast<std::size_t>(i)) % 8];
    }
    enterRoom(store, index, i, room, 0, 1);
  }
  const auto links =
      place::findLinks(store, index, allOf(store), [&](std::size_t a, std::size_t b) {
        return store[a].segment != store[b].segment;
      });
  for (const place::Link& link : links) EXPECT_GT(link.wrong_probability, 1e-4);
}

TEST(LoopsTest, DriftOfAWayRoundIsTakenBack) {
  if (!canCloseLoops()) GTEST_SKIP() << "built without Ceres";
  place::KeyframeStore store;
  place::BinaryIndex index;
  const synthetic::Scene room = synthetic::makeRoom(5);
  SE3 before;
  Similarity drifted;
  std::vector<SE3> truth;
  for (int k = 0; k < 60; ++k) {  // 45 once round
    const SE3 pose = synthetic::roundPose(6 * k, 1);
    const Similarity step{before.inverse() * pose, k > 0 ? 1.001 : 1};
    drifted = drifted * step;
    drifted.motion = drifted.motion * SE3(so3Exp({4e-4, 2e-4, 0}), Eigen::Vector3d::Zero());
    before = pose;
    truth.push_back(pose);
    enterView(store, index, 0, room, pose, drifted.motion);
  }
  store.triangulate(0);
  const auto links =
      place::findLinks(store, index, {47, 50, 53, 56, 59}, [&](std::size_t a, std::size_t b) {
        return a > b + 10 && !store.shareTracks(a, b);
      });
  ASSERT_GE(links.size(), 2U);
  const auto gap = [&] {  // between two views of one place, 14 keyframes from the end
    const SE3 told = store[1].T_world_cam.inverse() * store[46].T_world_cam;
    return (told.inverse() * truth[1].inverse() * truth[46]).translation().norm();
  };
  const double drift = gap();
  EXPECT_GT(drift, 0.02);
  const std::vector<Similarity> moves = place::closeLoops(store, 0, links, 1);
  ASSERT_EQ(moves.size(), store.size());
  for (std::size_t k = 0; k < moves.size(); ++k) store.move(k, moves[k]);
  EXPECT_LT(gap(), 0.3 * drift);
}

TEST(KeyframeStoreTest, TwoThousandKeyframesTakeSixtyMegabytes) {
  Random random(3);
  place::BinaryIndex index;
  place::StoredKeyframe keyframe;
  keyframe.view.descriptors.resize(place::kViewFeatures);
  keyframe.view.pixels.resize(place::kViewFeatures);
  keyframe.view.octaves.resize(place::kViewFeatures);
  keyframe.tracks.resize(place::kViewFeatures);
  keyframe.inverse_depths.resize(place::kViewFeatures);
  keyframe.sigmas.resize(place::kViewFeatures);
  std::vector<place::StoredKeyframe> keyframes(2000, keyframe);
  for (place::StoredKeyframe& one : keyframes) {
    for (BinaryDescriptor& descriptor : one.view.descriptors) descriptor = randomDescriptor(random);
    index.add(one.view.descriptors);
  }
  place::KeyframeStore store;
  store.append(std::move(keyframes));
  EXPECT_LT(store.bytes() + index.bytes(), 60'000'000U);
}

/// What is told of each frame.
struct BroughtBack : OdometryObserver {
  void onFrame(const FrameEstimate& estimate) override { told.push_back(estimate); }
  std::vector<FrameEstimate> told;
};

TEST(RecognitionTest, ACameraThatIsBroughtBackGoesOnInItsSegment) {
  const PinholeCamera camera{200, 200, 159.5, 119.5, 320, 240};
  const synthetic::Scene room = synthetic::makeRoom(5);
  Odometry odometry(camera, {});
  Place place{PlaceOptions{}};
  BroughtBack run;
  odometry.addObserver(&place);
  odometry.addObserver(&run);
  odometry.setRecognizer(place.recognizer(camera));
  constexpr int kAhead = 75;
  constexpr int kAfter = 12;
  for (int i = 0; i < kAhead + kAfter; ++i) {
    const int at = i < kAhead ? i : i - kAhead + 4;
    const double aside = at <= 40 ? 0 : 0.045 * (at - 40);  // [rad]
    const SE3 pose =
        synthetic::roomPose(at, 1) * SE3(so3Exp({0, aside, 0}), Eigen::Vector3d::Zero());
    const synthetic::View view = synthetic::render(room, camera, pose);
    FrameInfo info;
    info.id = FrameId{i};
    info.timestamp = i / 30.0;
    odometry.process(Frame::create(ImageView(view.intensity.data(), 320, 240), info));
  }
  const OdometryReport report = odometry.finish();
  EXPECT_EQ(report.segments, 1);
  EXPECT_EQ(report.recognized, 1);
  EXPECT_EQ(report.frames_missed, 0);
  // The same camera twice: the second time where the first one was.
  const auto poseAt = [&](int at) { return *run.told[static_cast<std::size_t>(at)].T_world_cam; };
  const double way = (poseAt(kAhead - 1).translation() - poseAt(20).translation()).norm();
  for (int i = kAhead; i < kAhead + kAfter; ++i) {
    const FrameEstimate& estimate = run.told[static_cast<std::size_t>(i)];
    ASSERT_TRUE(estimate.T_world_cam) << i << name(estimate.state);
    EXPECT_EQ(estimate.segment, 0);
  }
  const SE3 again = poseAt(kAhead + kAfter - 1);
  const int first = kAfter - 1 + 4;
  if (const auto& before = run.told[static_cast<std::size_t>(first)].T_world_cam) {
    EXPECT_LT((before->inverse() * again).translation().norm(), 0.01 * way);
  }
}

const PinholeCamera kRoomCamera{200, 200, 159.5, 119.5, 320, 240};

FramePtr roomFrame(int id, const synthetic::View& view) {
  FrameInfo info;
  info.id = FrameId{id};
  return Frame::create(ImageView(view.intensity.data(), view.width, view.height), info);
}

/// Keyframes of a rendered room by the truth, with every sixth pixel as a point.
/// @param S_world_room of the segment, whose number is that of the first keyframe
void tellRoom(const synthetic::Scene& room,
              place::RecentViews& views,
              int first = 0,
              const Similarity& S_world_room = {}) {
  for (int k = first; k < first + 6; ++k) {
    const SE3 pose = synthetic::roomPose(5 * k, 1);
    KeyframeSnapshot keyframe;
    keyframe.id = FrameId{k};
    keyframe.segment = first;
    keyframe.camera = kRoomCamera;
    keyframe.T_world_cam = S_world_room.moved(pose);
    const synthetic::View view = synthetic::render(room, kRoomCamera, pose);
    for (int y = 0; y < view.height; y += 6) {
      for (int x = 0; x < view.width; x += 6) {
        MapPoint point;
        point.pixel = Eigen::Vector2i(x, y).cast<float>();
        point.inverse_depth = view.inverse_depth[static_cast<std::size_t>(y * view.width + x)] /
                              static_cast<float>(S_world_room.scale);
        keyframe.points.push_back(point);
      }
    }
    views.add(*place::viewOf(keyframe.id, *roomFrame(k, view)));
    views.tell(keyframe);
  }
}

TEST(RecentViewsTest, FindAFrameThatIsTurnedAndFartherAway) {
  const synthetic::Scene room = synthetic::makeRoom(5);
  place::RecentViews views;
  tellRoom(room, views);
  const SE3 pose =
      synthetic::roomPose(12, 1) * SE3(so3Exp({0, 0.1, 0.8}), Eigen::Vector3d(0.2, 0, -0.4));
  const FramePtr frame = roomFrame(50, synthetic::render(room, kRoomCamera, pose));
  const auto found = views.find(*frame, kRoomCamera);
  ASSERT_TRUE(found);
  const SE3 error = pose.inverse() * found->T_world_cam;
  EXPECT_LT(error.translation().norm(), 0.05);
  EXPECT_LT(so3Log(error.unitQuaternion()).norm(), 0.01);
  ASSERT_TRUE(found->keyframe && found->T_cam_keyframe);
  EXPECT_LT((synthetic::roomPose(5 * found->keyframe->value, 1).inverse() * found->T_world_cam *
             *found->T_cam_keyframe)
                .log()
                .norm(),
            1e-9);
}

TEST(RecentViewsTest, FindNoOtherRoomAndGiveUp) {
  place::RecentViews views;
  tellRoom(synthetic::makeRoom(5), views);
  const auto isFound = [&](const synthetic::Scene& room) {
    const synthetic::View view = synthetic::render(room, kRoomCamera, synthetic::roomPose(12, 1));
    return views.find(*roomFrame(50, view), kRoomCamera).has_value();
  };
  for (std::uint64_t other = 21; other < 25; ++other) {
    EXPECT_FALSE(isFound(synthetic::makeRoom(other)));
  }
  EXPECT_FALSE(isFound(synthetic::makeRoom(5))) << "is looked for no more after four in vain";
}

/// The room `seed` with the walls, the floor and the ceiling of another one.
synthetic::Scene refurnished(const synthetic::Scene& walls, std::uint64_t seed) {
  synthetic::Scene room = synthetic::makeRoom(seed);
  for (std::size_t i = 0; i < room.textures.size(); ++i) {
    room.textures[i] = walls.textures[i % walls.textures.size()];
  }
  return room;
}

TEST(RecentViewsTest, FindNoRoomThatHasTheSameWalls) {
  const synthetic::Scene walls = synthetic::makeRoom(5);
  place::RecentViews views;
  tellRoom(refurnished(walls, 22), views);
  const auto isFound = [&](std::uint64_t seed) {
    const synthetic::View view =
        synthetic::render(refurnished(walls, seed), kRoomCamera, synthetic::roomPose(12, 1));
    return views.find(*roomFrame(50, view), kRoomCamera).has_value();
  };
  EXPECT_FALSE(isFound(21));
  EXPECT_TRUE(isFound(22));
  EXPECT_FALSE(isFound(23));
}

TEST(RecentViewsTest, LinkAnotherSegmentOfTheSameRoomAndNoneOfAnotherRoom) {
  place::RecentViews views;
  tellRoom(synthetic::makeRoom(5), views);
  std::map<FrameId, std::size_t> positions;
  for (int k = 0; k < 12; ++k) positions[FrameId{k}] = static_cast<std::size_t>(k);
  const Similarity S_world_room{SE3(so3Exp({0.1, 0.4, 0}), Eigen::Vector3d(1, 2, 3)), 2.5};
  place::RecentViews same;
  tellRoom(synthetic::makeRoom(5), same, 6, S_world_room);
  const std::vector<place::Link> links = views.linksTo(same, positions);
  ASSERT_EQ(links.size(), 3U) << "every second of six";
  for (const place::Link& link : links) {
    const Similarity off = link.S_to_from * S_world_room;  // nothing
    EXPECT_LT(off.motion.log().norm(), 0.05);
    EXPECT_NEAR(off.scale, 1, 0.01);
    EXPECT_GE(link.from, 6U);
    EXPECT_LT(link.to, 6U);
    EXPECT_EQ(link.covariance.llt().info(), Eigen::Success);
  }
  // The other way round each keyframe counts as well.
  const std::vector<place::Link> back = same.linksTo(views, positions);
  ASSERT_EQ(back.size(), 3U);
  EXPECT_LT((back.front().S_to_from * S_world_room.inverse()).motion.log().norm(), 0.1);
  place::RecentViews other;
  tellRoom(synthetic::makeRoom(21), other, 6, S_world_room);
  EXPECT_TRUE(views.linksTo(other, positions).empty());
}

class MapFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    place::BinaryIndex index;
    enterRoom(store_, index, 0, synthetic::makeRoom(5), 0, 1);
    place::writeMap(file_, store_.keyframes());
  }
  void expectRefused(const std::string& why) const {
    try {
      (void)place::readMap(file_);
      FAIL() << "was read";
    } catch (const IoError& error) {
      const std::string text = error.what();
      EXPECT_NE(text.find(file_), std::string::npos) << text;
      EXPECT_NE(text.find(why), std::string::npos) << text;
    }
  }
  TemporaryFolder folder_;
  std::string file_ = (folder_.path() / "map.db").string();
  place::KeyframeStore store_;
};

TEST_F(MapFileTest, ComesBackAsItWas) {
  const std::vector<place::StoredKeyframe> read = place::readMap(file_);
  ASSERT_EQ(read.size(), store_.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_EQ(read[i].id, store_[i].id);
    EXPECT_EQ(read[i].T_world_cam.matrix(), store_[i].T_world_cam.matrix());
    EXPECT_EQ(read[i].view.descriptors, store_[i].view.descriptors);
    EXPECT_EQ(read[i].tracks, store_[i].tracks);
    EXPECT_EQ(read[i].inverse_depths, store_[i].inverse_depths);
    ASSERT_EQ(read[i].view.size(), store_[i].view.size());
    for (std::size_t f = 0; f < read[i].view.size(); ++f) {  // COLMAP's half pixel costs a bit
      EXPECT_LT((read[i].view.pixels[f] - store_[i].view.pixels[f]).norm(), 1e-4);
    }
  }
}

TEST_F(MapFileTest, OtherFilesAreRefusedByName) {
  std::ofstream(file_, std::ios::trunc) << "no map";
  expectRefused("not a");
}

TEST_F(MapFileTest, DamageIsRefusedByName) {
  std::fstream file(file_, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(4096);
  file << std::string(3000, '\xFF');
  file.close();
  expectRefused("");
}

TEST_F(MapFileTest, WhatIsNoMapIsNotReplaced) {
  std::ofstream(file_, std::ios::trunc) << "somebody's notes";
  EXPECT_THROW(place::writeMap(file_, store_.keyframes()), IoError);
}

}  // namespace
}  // namespace dsorb
