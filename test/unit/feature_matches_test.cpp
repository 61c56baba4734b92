// SPDX-License-Identifier: BSD-3-Clause
#include "features/feature_matches.h"

#include "features/scale_features.h"
#include "support/painted_frame.h"

#include <gtest/gtest.h>
#include <opencv2/features2d.hpp>

#include <algorithm>
#include <limits>
#include <set>

namespace dsorb::init_orb {
namespace {

constexpr int kMatchWidth = 320;
constexpr int kMatchHeight = 240;
const Eigen::Vector2f kShift(7.3F, -4.6F);

FramePtr paintMatches(int id, const Paint& intensity) {
  return paintFrame(id, kMatchWidth, kMatchHeight, intensity);
}

Features featuresOf(const Paint& scene) {
  return findFeatures(greyImage(paintMatches(0, scene)->level(0), 1, 15));
}

Paint shiftedScene(std::uint64_t seed) {
  return shifted(blobs(seed), kShift.x(), kShift.y());
}

TEST(FeatureMatches, FindAShiftedSceneAgain) {
  const Features from = featuresOf(blobs(1));
  const Features to = featuresOf(shiftedScene(1));
  const std::vector<int> partner = matchFeatures(from, to);
  std::vector<float> errors;  // before refinement
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] < 0) continue;
    const cv::Point2f moved =
        to.points[static_cast<std::size_t>(partner[i])].pt - from.points[i].pt;
    errors.push_back((Eigen::Vector2f(moved.x, moved.y) - kShift).norm());
  }
  std::sort(errors.begin(), errors.end());
  ASSERT_GT(errors.size(), 100U);
  // Features lie on whole pixels of their pyramid level, 3.6 px at the coarsest.
  EXPECT_LT(errors[errors.size() / 2], 1.0F);  // measured 0.5 and 1.5; margin x2
  EXPECT_LT(errors[errors.size() * 9 / 10], 3.0F);
}

TEST(ScaleFeatures, FindATurnedAndSmallerSceneAgain) {
  const Eigen::Vector2f middle(kMatchWidth / 2.0F, kMatchHeight / 2.0F);
  const Eigen::Matrix2f turned = 1.6F * Eigen::Rotation2Df(0.9F).toRotationMatrix();
  const auto before = [&](const Eigen::Vector2f& place) -> Eigen::Vector2f {
    return turned * (place - middle) + middle;
  };
  const auto found = [](const Paint& scene) {
    return findScaleFeatures(greyImage(paintMatches(0, scene)->level(0), 1, 15), 500);
  };
  const Features from = found(blobs(1));
  const Features to = found([&, base = blobs(1)](float x, float y) {
    const Eigen::Vector2f place = before({x, y});
    return base(place.x(), place.y());
  });
  const std::vector<int> partner = partnersOf(scaleDistances(from, to), {}, kMaxRatio, 2);
  int right = 0;
  int wrong = 0;
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] < 0) continue;
    const cv::Point2f& place = to.points[static_cast<std::size_t>(partner[i])].pt;
    const Eigen::Vector2f start(from.points[i].pt.x, from.points[i].pt.y);
    ((before({place.x, place.y}) - start).norm() < 3 ? right : wrong) += 1;
  }
  EXPECT_GT(right, 50);
  EXPECT_LT(wrong, right / 4);
}

TEST(FeatureMatches, SpreadTheFeaturesOverTheImage) {
  // One quarter of the image has five times the contrast of the others.
  const Paint scene = [base = blobs(3)](float x, float y) {
    const float contrast = x < kMatchWidth && y < kMatchHeight ? 1.0F : 0.2F;
    return 128.0F + contrast * (base(x, y) - 128.0F);
  };
  const FramePtr frame = paintFrame(0, 2 * kMatchWidth, 2 * kMatchHeight, scene);
  const std::vector<cv::KeyPoint> found = findFeatures(greyImage(frame->level(0), 1, 15)).points;
  const auto loud = std::count_if(found.begin(), found.end(), [](const cv::KeyPoint& p) {
    return p.pt.x < kMatchWidth && p.pt.y < kMatchHeight;
  });
  ASSERT_GT(found.size(), 1000U);
  EXPECT_LE(loud, 1000);  // 20 of 80 cells, each twice its share; unspread all are there
}

TEST(FeatureMatches, KeepAwayFromInvalidPixels) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Paint scene = [base = blobs(4), nan](float x, float y) {
    return x > 100 && x < 200 ? nan : base(x, y);
  };
  const std::vector<cv::KeyPoint> found = featuresOf(scene).points;
  ASSERT_FALSE(found.empty());
  for (const cv::KeyPoint& point : found) EXPECT_TRUE(point.pt.x < 100 || point.pt.x > 200);
}

TEST(FeatureMatches, PartnersAreMutual) {
  const Features from = featuresOf(blobs(5));
  const Features to = featuresOf(shiftedScene(5));
  const std::vector<int> partner = matchFeatures(from, to);
  std::multiset<int> taken;
  for (const int index : partner) {
    if (index >= 0) taken.insert(index);
  }
  ASSERT_GT(taken.size(), 100U);
  for (const int index : taken) EXPECT_EQ(taken.count(index), 1U);
}

TEST(FeatureMatches, ArePartnersByOpenCvsMatcherToo) {
  const Features from = featuresOf(blobs(7));
  const Features to = featuresOf(shiftedScene(7));
  const std::vector<int> partner = matchFeatures(from, to);
  const cv::BFMatcher matcher(cv::NORM_HAMMING);
  std::vector<std::vector<cv::DMatch>> forward;
  std::vector<cv::DMatch> backward;
  matcher.knnMatch(from.descriptors, to.descriptors, forward, 2);
  matcher.match(to.descriptors, from.descriptors, backward);
  for (std::size_t i = 0; i < forward.size(); ++i) {
    const cv::DMatch& best = forward[i][0];
    const bool expected =
        backward[static_cast<std::size_t>(best.trainIdx)].trainIdx == static_cast<int>(i) &&
        best.distance < kMaxRatio * static_cast<double>(forward[i][1].distance) &&
        best.distance <= static_cast<float>(kMaxDistance);
    EXPECT_EQ(partner[i], expected ? best.trainIdx : -1) << "feature " << i;
  }
}

}  // namespace
}  // namespace dsorb::init_orb
