// SPDX-License-Identifier: BSD-3-Clause
#include "init/result.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <vector>

namespace dsorb {
namespace {

FramePtr plainFrame(int id) {
  const std::vector<std::uint8_t> pixels(32 * 24, 100);
  return Frame::create({pixels.data(), 32, 24}, {FrameId{id}, 0.1 * id, 1, nullptr});
}

InitializationResult validResult() {
  InitializationResult result;
  result.frames.push_back({plainFrame(0), SE3(), {}, std::nullopt});
  result.frames.push_back({plainFrame(1), std::nullopt, {}, std::nullopt});
  const SE3 moved(so3Exp({0, 0.1, 0}), Eigen::Vector3d(0.5, 0, 0.1));
  result.frames.push_back({plainFrame(2), moved, {0.1, 2}, Matrix6d::Identity() * 1e-4});
  result.points = {{0, {5, 5}, 0.5F, 0.01F, 2}, {0, {20, 10}, 1.5F, 0.02F, 2}};
  return result;
}

TEST(CheckInvariants, AcceptsAValidResult) {
  EXPECT_NO_THROW(checkInvariants(validResult()));
}

struct Violation {
  const char* clause;
  std::function<void(InitializationResult&)> break_it;
};

void PrintTo(const Violation& violation, std::ostream* stream) {
  *stream << violation.clause;
}

class CheckInvariantsRefuses : public testing::TestWithParam<Violation> {};

TEST_P(CheckInvariantsRefuses, AndNamesTheClause) {
  InitializationResult result = validResult();
  GetParam().break_it(result);
  try {
    checkInvariants(result);
    FAIL() << "accepted";
  } catch (const std::logic_error& error) {
    EXPECT_NE(std::string(error.what()).find(GetParam().clause), std::string::npos) << error.what();
  }
}

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
using Result = InitializationResult;

INSTANTIATE_TEST_SUITE_P(
    EveryClause,
    CheckInvariantsRefuses,
    testing::Values(
        Violation{"at least two frames", [](Result& r) { r.frames.resize(1); }},
        Violation{"identity pose",
                  [](Result& r) {
                    r.frames[0].T_cam_ref->setTranslation({0, 0, 1e-9});
                  }},
        Violation{"a = b = 0", [](Result& r) { r.frames[0].affine.a = 0.1; }},
        Violation{"back frame is posed", [](Result& r) { r.frames[2].T_cam_ref.reset(); }},
        Violation{"has its image", [](Result& r) { r.frames[1].frame = nullptr; }},
        Violation{"affine brightness is finite", [](Result& r) { r.frames[1].affine.b = NAN; }},
        Violation{"pose is finite",
                  [](Result& r) {
                    r.frames[2].T_cam_ref->setTranslation({0, NAN, 0});
                  }},
        Violation{"covariance is finite", [](Result& r) { (*r.frames[2].covariance)(0, 0) = NAN; }},
        Violation{"covariance is symmetric",
                  [](Result& r) { (*r.frames[2].covariance)(0, 1) = 1; }},
        Violation{"positive semi-definite",
                  [](Result& r) { (*r.frames[2].covariance)(5, 5) = -1; }},
        Violation{"host is one of the frames", [](Result& r) { r.points[1].host = 3; }},
        Violation{"host is posed", [](Result& r) { r.points[1].host = 1; }},
        Violation{"inverse depth is finite", [](Result& r) { r.points[0].inverse_depth = kNan; }},
        Violation{"inverse depth is finite", [](Result& r) { r.points[0].inverse_depth = 0; }},
        Violation{"variance is finite", [](Result& r) { r.points[0].variance = 0; }},
        Violation{"border, x", [](Result& r) { r.points[0].pixel.x() = 1.9F; }},
        Violation{"border, x", [](Result& r) { r.points[0].pixel.x() = 29.1F; }},
        Violation{"border, y", [](Result& r) { r.points[0].pixel.y() = kNan; }},
        Violation{"mean inverse depth", [](Result& r) { r.points[0].inverse_depth = 0.6F; }},
        Violation{"mean inverse depth", [](Result& r) { r.points.clear(); }}));

TEST(NormalizeScale, MakesTheMeanOneAndKeepsTheGeometry) {
  InitializationResult result = validResult();
  result.points.push_back({2, {10, 10}, 40.0F, 1.0F, 1});  // hosted elsewhere: not in the mean
  for (InitPoint& point : result.points) point.inverse_depth *= 4;
  const InitializationResult before = result;
  normalizeScale(result);
  EXPECT_FLOAT_EQ(result.points[0].inverse_depth, 0.5F);
  EXPECT_FLOAT_EQ(result.points[1].inverse_depth, 1.5F);
  EXPECT_FLOAT_EQ(result.points[2].inverse_depth, 40.0F);
  for (std::size_t i = 0; i < result.points.size(); ++i) {
    const float sigma = std::sqrt(result.points[i].variance) / result.points[i].inverse_depth;
    const float sigma_before =
        std::sqrt(before.points[i].variance) / before.points[i].inverse_depth;
    EXPECT_FLOAT_EQ(sigma, sigma_before);
  }
  const SE3& pose = *result.frames[2].T_cam_ref;
  EXPECT_TRUE(pose.translation().isApprox(4 * before.frames[2].T_cam_ref->translation(), 1e-7));
  EXPECT_EQ(pose.rotationMatrix(), before.frames[2].T_cam_ref->rotationMatrix());
  EXPECT_NEAR((*result.frames[2].covariance)(0, 0), 16e-4, 1e-10);
  EXPECT_NEAR((*result.frames[2].covariance)(4, 4), 1e-4, 1e-12);
}

TEST(NormalizeScale, RefusesAResultWithoutPositiveMean) {
  InitializationResult result = validResult();
  result.points[1].inverse_depth = -0.5F;
  EXPECT_THROW(normalizeScale(result), std::logic_error);
}

}  // namespace
}  // namespace dsorb
