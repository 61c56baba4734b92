// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"

#include "io/input/image_decoder.h"
#include "io/output/figures.h"
#include "support/temporary_folder.h"

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include <string>
#include <vector>

namespace dsorb {
namespace {

std::vector<std::uint8_t> written(const cv::Mat& image) {
  const TemporaryFolder folder;
  io::writePng(folder.path() / "image.png", image);
  return readFile(folder.path() / "image.png");
}

cv::Mat randomImage(int type) {
  cv::Mat image(37, 53, type);
  cv::RNG random(7);
  random.fill(image, cv::RNG::UNIFORM, 0, image.depth() == CV_16U ? 65536 : 256);
  return image;
}

void expectEqual(const cv::Mat& found, const cv::Mat& expected) {
  ASSERT_EQ(found.type(), expected.type());
  ASSERT_EQ(found.size(), expected.size());
  EXPECT_EQ(cv::norm(found, expected, cv::NORM_INF), 0);
}

TEST(Png, GreyComesBackAsItWas) {
  for (const int type : {CV_8UC1, CV_16UC1}) {
    const cv::Mat image = randomImage(type);
    expectEqual(decodeGrey(written(image), "image"), image);
  }
}

TEST(Png, ColoursAreWrittenAsOpenCvReadsThem) {
  const cv::Mat image = randomImage(CV_8UC3);
  expectEqual(cv::imdecode(written(image), cv::IMREAD_COLOR), image);
}

TEST(Png, EveryKindIsReadAsByOpenCv) {
  for (const int type : {CV_8UC1, CV_8UC3, CV_8UC4, CV_16UC1, CV_16UC3, CV_16UC4}) {
    SCOPED_TRACE(type);
    std::vector<std::uint8_t> bytes;
    cv::imencode(".png", randomImage(type), bytes);
    expectEqual(decodeGrey(bytes, "image"),
                cv::imdecode(bytes, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH));
  }
  std::vector<std::uint8_t> bits;
  cv::imencode(".png", randomImage(CV_8UC1) > 127, bits, {cv::IMWRITE_PNG_BILEVEL, 1});
  expectEqual(decodeGrey(bits, "image"), cv::imdecode(bits, cv::IMREAD_GRAYSCALE));
}

/// Red, green, blue and grey in a palette of four colours, two bits a pixel.
constexpr unsigned char kPalette[] = {
    0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48, 0x44, 0x52,
    0x00, 0x00, 0x00, 0x04, 0x00, 0x00, 0x00, 0x01, 0x02, 0x03, 0x00, 0x00, 0x00, 0x84, 0x52, 0xe7,
    0x5e, 0x00, 0x00, 0x00, 0x0c, 0x50, 0x4c, 0x54, 0x45, 0xc8, 0x0a, 0x1e, 0x14, 0xb4, 0x28, 0x0f,
    0x19, 0xdc, 0x5a, 0x5a, 0x5a, 0xbd, 0xae, 0x2b, 0x29, 0x00, 0x00, 0x00, 0x0a, 0x49, 0x44, 0x41,
    0x54, 0x78, 0xda, 0x63, 0x90, 0x06, 0x00, 0x00, 0x1d, 0x00, 0x1c, 0x23, 0x7c, 0x8f, 0xac, 0x00,
    0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};

TEST(Png, PaletteIsReadAsByOpenCv) {
  const std::vector<std::uint8_t> bytes(std::begin(kPalette), std::end(kPalette));
  const cv::Mat image = decodeGrey(bytes, "image");
  ASSERT_EQ(image.size(), cv::Size(4, 1));
  expectEqual(image, cv::imdecode(bytes, cv::IMREAD_GRAYSCALE));
}

TEST(Png, MissingAndChangedBytesAreNamed) {
  const std::vector<std::uint8_t> whole = written(randomImage(CV_8UC1));
  for (const std::size_t size : {whole.size() - 1, whole.size() / 2, std::size_t{9}}) {
    const std::vector<std::uint8_t> part(whole.begin(),
                                         whole.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_THROW((void)decodeGrey(part, "left.png"), IoError) << size;
  }
  std::vector<std::uint8_t> changed = whole;
  changed[whole.size() / 2] ^= 1U;
  try {
    (void)decodeGrey(changed, "left.png");
    FAIL() << "a changed byte passed";
  } catch (const IoError& error) {
    EXPECT_EQ(std::string(error.what()).rfind("left.png: the image is truncated or damaged: ", 0),
              0)
        << error.what();
  }
}

}  // namespace
}  // namespace dsorb
