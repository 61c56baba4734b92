// SPDX-License-Identifier: BSD-3-Clause
// A start from the essential matrix, without images: model selection, gate, noise.
#include "init/orb/start/essential_start.h"

#include "base/spread_frames.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/result.h"
#include "support/assign_map.h"
#include "support/matchers.h"
#include "support/synthetic_map.h"
#include "support/two_view_scene.h"
#include "two_view/essential_motion.h"
#include "two_view/model_selection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr std::uint64_t kSeed = 1;

TEST(EssentialMotion, IsFoundAmongFortyPercentOutliers) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const TwoViewScene scene = makeTwoViewScene({400, false, {0.6, 0.1, 0.3}, 0.3, 0.4}, seed);
    const auto motion = estimateEssentialMotion(scene.matches, scene.camera, kSeed);
    ASSERT_TRUE(motion) << seed;
    EXPECT_GE(motion->inliers, 200) << seed;  // 240 are right
    EXPECT_LT(rotationErrorDeg(motion->T_cur_ref, scene.T_cur_ref), 0.2) << seed;
    EXPECT_LT(directionErrorDeg(motion->T_cur_ref.translation(), scene.T_cur_ref.translation()),
              1.0)
        << seed;
    EXPECT_NEAR(motion->noise, 0.25, 0.15) << seed;  // .3 px in one of two images: .3 / sqrt 2
  }
}

TEST(EssentialMotion, GivesTheSameBitsTwice) {
  const TwoViewScene scene = makeTwoViewScene({300, false, {0.6, 0.1, 0.3}, 0.3, 0.4}, 3);
  const auto first = estimateEssentialMotion(scene.matches, scene.camera, kSeed);
  const auto second = estimateEssentialMotion(scene.matches, scene.camera, kSeed);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->T_cur_ref.matrix(), second->T_cur_ref.matrix());
  EXPECT_EQ(first->inlier, second->inlier);
}

TEST(EssentialMotion, IsRefusedWithFewMatches) {
  for (const int points : {2, 7, 40}) {
    const TwoViewScene scene = makeTwoViewScene({points, false, {0.6, 0.1, 0.3}, 0.3}, 4);
    EXPECT_FALSE(estimateEssentialMotion(scene.matches, scene.camera, kSeed)) << points;
  }
}

/// The model of least criterion, all fitted to the scene.
DisplacementModel winner(const TwoViewScene& scene, double sigma) {
  const auto motion = estimateEssentialMotion(scene.matches, scene.camera, kSeed);
  const auto H = estimateHomography(scene.matches, kSeed);
  std::vector<double> errors =
      motion ? epipolarDistances(motion->T_cur_ref, scene.matches, scene.camera)
             : std::vector<double>(scene.matches.size(), 1e6);
  for (double& error : errors) error *= error;
  const double essential = gric(DisplacementModel::kEssential, errors, sigma);
  const double homography =
      H ? gric(DisplacementModel::kHomography, homographySampsonErrors(*H, scene.matches), sigma)
        : 1e12;
  const RotationFit fit = fitRotation(scene.matches, scene.camera);
  const double rotation = gric(DisplacementModel::kRotation,
                               rotationSampsonErrors(fit.R_cur_ref, scene.matches, scene.camera),
                               sigma);
  if (rotation < std::min(homography, essential)) return DisplacementModel::kRotation;
  return homography < essential ? DisplacementModel::kHomography : DisplacementModel::kEssential;
}

TEST(ModelSelection, NamesRotationPlaneAndGeneralMotion) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const TwoViewScene turned = makeTwoViewScene({300, false, {0, 0, 0}, 0.4}, seed);
    const TwoViewScene plane = makeTwoViewScene({300, true, {0.6, 0.1, 0.3}, 0.4}, seed);
    const TwoViewScene general = makeTwoViewScene({300, false, {0.6, 0.1, 0.3}, 0.4}, seed);
    EXPECT_STREQ(name(winner(turned, 0.5)), "rotation") << seed;
    EXPECT_STREQ(name(winner(plane, 0.5)), "homography") << seed;
    EXPECT_STREQ(name(winner(general, 0.5)), "essential") << seed;
  }
}

/// Tracks of points on a plane, seen along a bent path.
struct PlaneTracks {
  PinholeCamera camera{450, 450, 319.5, 239.5, 640, 480};
  std::vector<SE3> T_cam_ref;
  ReferenceView view;
};

PlaneTracks makePlaneTracks(int frames, std::uint64_t seed) {
  PlaneTracks scene;
  Random random(seed);
  const Eigen::Vector3d normal(0.3, -0.2, 1);
  for (int k = 0; k < frames; ++k) {
    const double path = static_cast<double>(k) / (frames - 1);
    scene.T_cam_ref.emplace_back(so3Exp({0.02 * path, -0.05 * path, 0.03 * path}),
                                 Eigen::Vector3d(0.9 * path, 0.8 * path * (1 - path), 0.4 * path));
  }
  scene.view.frames.resize(static_cast<std::size_t>(frames));
  scene.view.tracks.positions.resize(static_cast<std::size_t>(frames));
  while (scene.view.tracks.size() < 200) {
    const Eigen::Vector2d pixel{random.uniform(90, 550), random.uniform(70, 410)};
    const Eigen::Vector3d ray = scene.camera.unproject(pixel);
    for (std::size_t k = 0; k < scene.T_cam_ref.size(); ++k) {
      const Eigen::Vector2d noise{random.gaussian(), random.gaussian()};
      const Eigen::Vector2d seen =
          scene.camera.project(scene.T_cam_ref[k] * Eigen::Vector3d(6 / normal.dot(ray) * ray));
      scene.view.tracks.positions[k].emplace_back(
          (seen + (k > 0 ? 0.2 : 0.0) * noise).cast<float>());
    }
  }
  return scene;
}

TEST(MotionCandidates, FramesBetweenDecideWhichMotionOfAPlaneIsRight) {
  const PlaneTracks scene = makePlaneTracks(6, 8);
  InitializerOptions options;
  StageClock clock;
  const AttemptContext context{scene.camera, options, clock};
  const Matches matches = scene.view.tracks.matchesTo(5);
  const auto H = estimateHomography(matches, kSeed);
  ASSERT_TRUE(H);
  const std::vector<EssentialMotion> motions = planeMotions(*H, matches, scene.camera);
  ASSERT_EQ(motions.size(), 2U);
  const Eigen::Vector3d truth = scene.T_cam_ref.back().translation();
  const auto errorOf = [&](const SE3& pose) {
    return directionErrorDeg(pose.translation(), truth);
  };
  for (const EssentialMotion& start : motions) {  // the right and the wrong one
    auto best = makeCandidate(scene.view, start, context);
    ASSERT_TRUE(best);
    const bool wrong = errorOf(start.T_cur_ref) > 20;
    const Competition outcome = competeOverFrames(scene.view, motions, context, *best);
    EXPECT_LT(errorOf(*best->map.frames.back().T_cam_ref), 2.0);
    EXPECT_LT(rivalProbability(outcome.cost_ratio, 40),
              0.01);  // 40 cells of the image are occupied
    if (wrong) {
      EXPECT_TRUE(outcome.replaced);
    }
  }
  EXPECT_GT(std::max(errorOf(motions[0].T_cur_ref), errorOf(motions[1].T_cur_ref)), 20.0);
}

TEST(MotionCandidates, CellsDecideTogether) {
  MotionCandidate best;
  MotionCandidate other;
  best.cell_costs.assign(81, 0);
  std::fill_n(best.cell_costs.begin(), 30, 1);  // the others have no tracks
  EXPECT_EQ(costRatio(best, best), 1);
  other = best;
  for (std::size_t i = 0; i < 30; ++i) other.cell_costs[i] += i % 2 == 0 ? 0.01 : -0.01;
  EXPECT_NEAR(costRatio(other, best), 1, 1e-12);
  other.cell_costs[7] = 1000;  // one cell among thirty that are undecided
  EXPECT_NEAR(costRatio(other, best), 1, 2e-3);
  std::fill_n(other.cell_costs.begin(), 30, 1.1);
  EXPECT_NEAR(costRatio(other, best), 1.1, 1e-12);
  EXPECT_NEAR(costRatio(best, other), 1 / 1.1, 1e-12);
  other = best;
  other.cell_costs.back() = 3;  // a gyroscope contradicts it
  EXPECT_NEAR(costRatio(other, best), 1.1, 1e-12);
}

TEST(RobustAdjustment, MeasuresTheNoiseThatWasDrawn) {
  for (const double noise : {0.05, 0.2, 0.8}) {
    SyntheticMap scene = makeSyntheticMap({300, 5, noise, 0.05}, 11);
    ASSERT_TRUE(assign(adjustRobustly(scene.start, scene.camera, {}), scene.start));
    const double sigma = adjustToNoise(scene.start, scene.camera, {}, 3).sigma;
    // The fit takes one of eight coordinates of every corner: .94 of the noise is left.
    EXPECT_NEAR(sigma / noise, 0.94, 0.08) << noise;
  }
}

TEST(RobustAdjustment, TellsTailsFromNoise) {
  for (const int frames : {2, 5}) {
    for (std::uint64_t seed = 21; seed < 29; ++seed) {
      SyntheticMap noisy = makeSyntheticMap({600, frames, 0.2, 0.05}, seed);
      ASSERT_TRUE(assign(adjustOnce(noisy.start, noisy.camera, {}), noisy.start));
      const double noise = tailExcess(noisy.start, noisy.camera);
      SyntheticMap tailed = makeSyntheticMap({600, frames, 0.2, 0.05}, seed);
      Random random(seed);
      for (CornerObservation& observation : tailed.start.observations) {
        if (random.uniform(0, 1) < 0.2) {
          observation.pixel += 0.8 * Eigen::Vector2d{random.gaussian(), random.gaussian()};
        }
      }
      ASSERT_TRUE(assign(adjustOnce(tailed.start, tailed.camera, {}), tailed.start));
      const double tails = tailExcess(tailed.start, tailed.camera);
      EXPECT_LT(noise, 0.15);  // measured up to 0.09
      EXPECT_GT(tails, 0.45);  // measured 0.55 to 1.6
    }
  }
}

TEST(RobustAdjustment, RemovesPlantedOutliersAndFindsTheTruth) {
  SyntheticMap scene = makeSyntheticMap({300, 5, 0.1, 0.1}, 12);
  for (CornerObservation& observation : scene.start.observations) {
    if (observation.corner % 5 == 0 && observation.frame == 3) {
      observation.pixel += Eigen::Vector2d(15, -20);
    }
  }
  ASSERT_TRUE(assign(adjustRobustly(scene.start, scene.camera, {}), scene.start));
  EXPECT_EQ(scene.start.corners.size(), 240U);
  EXPECT_LT(directionErrorDeg(scene.start.frames.back().T_cam_ref->translation(),
                              scene.truth.frames.back().T_cam_ref->translation()),
            0.2);
}

TEST(RobustAdjustment, TurnsAMotionOfTheWrongSign) {
  SyntheticMap scene = makeSyntheticMap({100, 4, 0, 0}, 13);
  InitialMap turned = scene.truth;
  for (Corner& corner : turned.corners) corner.inverse_depth *= -1;
  for (PosedFrame& frame : turned.frames) {
    frame.T_cam_ref->setTranslation(-frame.T_cam_ref->translation());
  }
  EXPECT_DOUBLE_EQ(flipToPositiveDepth(turned), 1);
  EXPECT_THAT(*turned.frames.back().T_cam_ref,
              Se3Near(*scene.truth.frames.back().T_cam_ref, 1e-12, 1e-12));
  EXPECT_GT(turned.corners.front().inverse_depth, 0);
}

/// An adjusted map with covariances, corners with an error of sigma [px].
SyntheticMap mapWithCovariances(const SyntheticMapOptions& options, std::uint64_t seed) {
  SyntheticMap scene = makeSyntheticMap(options, seed);
  EXPECT_TRUE(assign(adjustRobustly(scene.start, scene.camera, {}), scene.start));
  const GeometricOptions adjusted = adjustToNoise(scene.start, scene.camera, {}, 3);
  EXPECT_TRUE(normalizeCornerScale(scene.start));
  EXPECT_GT(setCovariances(scene.start, scene.camera, adjusted), 0);
  return scene;
}

TEST(StartGate, NamesWhatIsMissing) {
  const SyntheticMap scene = mapWithCovariances({300, 5, 0.1, 0.05}, 14);
  const auto judge = [&](const GateOptions& options, const StartEvidence& evidence) {
    return judgeStart(scene.start, scene.camera, options, evidence).reason;
  };
  EXPECT_EQ(judge({}, {{300}, 1, 1, {}}), InitReason::kDone);
  EXPECT_EQ(judge({}, {{700}, 1, 1, {}}), InitReason::kTooFewPoints);
  EXPECT_EQ(judge({}, {{300}, 0.7, 1, {}}), InitReason::kDegenerateMotion);
  EXPECT_EQ(judge({}, {{300}, 1, 1, 1.01}), InitReason::kDegenerateMotion) << "a plane";
  EXPECT_EQ(judge({}, {{300}, 1, 1, 1.5}), InitReason::kDone);
  GateOptions options;
  options.max_depth_sigma = 1e-4;
  EXPECT_EQ(judge(options, {{300}, 1, 1, {}}), InitReason::kTooLittleParallax);
  options = {};
  options.max_wrong_probability = 1e-12;
  EXPECT_EQ(judge(options, {{300}, 1, 1, {}}), InitReason::kPoorQuality);
}

TEST(StartGate, AMapNeedsHalfOfTheTracks) {
  InitialMap map;
  map.corners.resize(100);
  EXPECT_TRUE(hasEnoughCorners(map, {200}));
  EXPECT_FALSE(hasEnoughCorners(map, {201}));
  EXPECT_TRUE(hasEnoughCorners(map, {201, true}));
  map.corners.resize(59);
  EXPECT_FALSE(hasEnoughCorners(map, {59, true}));
}

TEST(StartGate, LostMatchesWidenWhatIsPredicted) {
  const SyntheticMap scene = mapWithCovariances({300, 5, 0.1, 0.05}, 14);
  const auto corners = static_cast<int>(scene.start.corners.size());
  const auto judge = [&](int matches) {
    return judgeStart(scene.start, scene.camera, {}, {{matches, true}, 1, 1, {}});
  };
  const GateReport half = judge(2 * corners);
  const GateReport third = judge(3 * corners);
  EXPECT_DOUBLE_EQ(judge(corners).direction_sigma_deg, half.direction_sigma_deg);
  EXPECT_NEAR(third.direction_sigma_deg, 1.5 * half.direction_sigma_deg, 1e-9);
  EXPECT_NEAR(third.depth_sigma, 1.5 * half.depth_sigma, 1e-9);
}

TEST(StartGate, MisfitWidensWhatIsPredicted) {
  SyntheticMap scene = mapWithCovariances({300, 5, 0.1, 0.05}, 14);
  const GateReport fits = judgeStart(scene.start, scene.camera, {}, {{300}, 1, 1, {}});
  widenCovariances(scene.start, 2);
  const GateReport misfits = judgeStart(scene.start, scene.camera, {}, {{300}, 1, 2, {}});
  EXPECT_DOUBLE_EQ(misfits.direction_sigma_deg, 2 * fits.direction_sigma_deg);
  EXPECT_DOUBLE_EQ(misfits.depth_sigma, 2 * fits.depth_sigma);
  EXPECT_GT(misfits.wrong_probability, fits.wrong_probability);
  EXPECT_EQ(misfitOf(0.5), 1);
  EXPECT_NEAR(misfitOf(2 * 1.1774), 2, 1e-12);
}

TEST(StartGate, ABackgroundNeedsItsDepthOnlyAsWellAsTheSceneDoes) {
  std::vector<Corner> corners(100);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    corners[i].inverse_depth = i < 30 ? 2 : 0.05;
    corners[i].variance = 0.02 * 0.02;  // 40 % of the background's
  }
  EXPECT_NEAR(depthSigma(corners), 0.01, 1e-12);
  for (std::size_t i = 20; i < 30; ++i) corners[i].inverse_depth = 0.05;
  EXPECT_NEAR(depthSigma(corners), 0.4, 1e-12) << "a fifth is not a scene";
}

TEST(StartGate, ErrorsThatShrinkPassEventually) {
  GateReport report;
  report.direction_sigma_deg = 4;
  report.second_sigma_deg = 1;
  report.depth_sigma = 0.06;
  EXPECT_FALSE(errorsPass(report, 1, {}));
  EXPECT_FALSE(errorsPass(report, 1.6, {})) << "its direction is not sure yet";
  EXPECT_TRUE(errorsPass(report, 4, {}));
}

TEST(StartGate, TailsAreThoseOfDrawnErrors) {
  // A t-distribution with 4 degrees of freedom on the plane: Gaussian over sqrt(chi^2 / 4).
  Random random(31);
  for (const Eigen::Vector2d& sigmas : {Eigen::Vector2d(1, 1), Eigen::Vector2d(0.3, 2)}) {
    constexpr int kDraws = 200000;
    int outside = 0;
    for (int i = 0; i < kDraws; ++i) {
      double chi2 = 0;
      for (int k = 0; k < 4; ++k) chi2 += std::pow(random.gaussian(), 2);
      const Eigen::Vector2d error =
          sigmas.cwiseProduct(Eigen::Vector2d{random.gaussian(), random.gaussian()}) /
          std::sqrt(chi2 / 4);
      if (error.norm() > 5) ++outside;
    }
    const double share = static_cast<double>(outside) / kDraws;
    const double sigma = std::sqrt(share / kDraws);
    EXPECT_NEAR(tailProbability(sigmas, 5), share, 4 * sigma);
  }
  EXPECT_EQ(tailProbability({0, 0}, 10), 0);
  EXPECT_EQ(rivalProbability(1, 40), 0.5);
}

TEST(SpreadFrames, CoverTheWholeTimeAndEndWithTheNewest) {
  EXPECT_EQ(dsorb::spreadFrames(2, 6), (std::vector<std::size_t>{1}));
  EXPECT_EQ(dsorb::spreadFrames(6, 6), (std::vector<std::size_t>{1, 2, 3, 4, 5}));
  EXPECT_EQ(dsorb::spreadFrames(31, 6), (std::vector<std::size_t>{6, 12, 18, 24, 30}));
}

}  // namespace
}  // namespace dsorb::init_orb
